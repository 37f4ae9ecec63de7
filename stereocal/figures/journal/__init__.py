"""Figures for print, drawn by Matplotlib from the data of the Plotly figures: SVG and PDF."""
