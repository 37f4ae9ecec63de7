"""Plotly figures of all results (`plot_*`), and their descriptions in words (`describe_*`).

Backgrounds are transparent and texts have no colour, so that the page's light or dark theme
applies.
"""
