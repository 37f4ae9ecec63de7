"""Drawings of the documentation, as SVG."""
