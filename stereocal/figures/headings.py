"""Headings of the tables of pairs and points on a page; the files keep their column names."""

from __future__ import annotations

from collections.abc import Mapping

HEADINGS: Mapping[str, str] = {
    "frame": "Frame",
    "u_primary": "u, primary (px)",
    "v_primary": "v, primary (px)",
    "u_secondary": "u, secondary (px)",
    "v_secondary": "v, secondary (px)",
    "error_px": "Error (px)",
    "runner_up_px": "Next best error (px)",
    "ambiguous": "Ambiguous",
    "x": "x, right (m)",
    "y": "y, down (m)",
    "z": "z, depth (m)",
    "sigma_x": "Standard error of x (m)",
    "sigma_y": "Standard error of y (m)",
    "sigma_z": "Standard error of z (m)",
    "outside_volume": "Outside the volume of the bars",
}
"""By the name of the column; a column of the user keeps its name."""
IN_WORLD: Mapping[str, str] = {
    **HEADINGS,
    "x": "x (m)",
    "y": "y (m)",
    "z": "z (m)",
    "coordinates": "World frame",
}
"""Of points in a world frame."""
