"""Common parts of 3D figures: upright axes of equal scale, and a viewpoint that shows the scene."""

from __future__ import annotations

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import GRID_3D, TRANSPARENT
from stereocal.rig.compiled import FloatArray

EYE_OF_DIAGONAL = 1.4
"""Distance of the eye over the scene's diagonal; also suitable for narrow screens."""
AXIS_TITLES = {"xaxis": "x (m)", "yaxis": "z (m), depth", "zaxis": "−y (m), up"}


def upright(points: FloatArray) -> dict[str, FloatArray]:
    """Points (..., 3) in the primary's frame, as the figure's coordinates: x, depth, up."""
    return {
        "x": points[..., 0].ravel(), "y": points[..., 2].ravel(), "z": -points[..., 1].ravel()
    }  # fmt: skip


def set_scene(figure: go.Figure) -> None:
    """Set equal axes in metres, and a viewpoint that shows everything drawn."""
    axis = {
        "showbackground": False, "gridcolor": GRID_3D, "linecolor": GRID_3D, "zeroline": False,
        "nticks": 6, "tickfont": {"size": 12}, "showspikes": False,
    }  # fmt: skip
    figure.update_layout(
        scene={
            "aspectmode": "data",
            "camera": _view(figure),
            "bgcolor": TRANSPARENT,
            **{
                name: {**axis, "title": {"text": title, "font": {"size": 14}}}
                for name, title in AXIS_TITLES.items()
            },
        }
    )


def _view(figure: go.Figure) -> dict[str, dict[str, float]]:
    """A viewpoint behind, right of and above the primary camera, from which the scene is visible.

    Plotly scales a scene to a volume of 1; the eye's distance is in that unit.
    """
    spans = [
        np.ptp(values[np.isfinite(values)])
        for values in (np.concatenate([trace[axis] for trace in figure.data]) for axis in "xyz")
    ]
    size = np.maximum(spans, 1e-3 * max(spans))
    distance = EYE_OF_DIAGONAL * np.linalg.norm(size / np.cbrt(np.prod(size)))
    x, y, z = (distance * np.array([0.42, -0.8, 0.43])).tolist()
    return {
        "eye": {"x": x, "y": y, "z": z},
        "up": {"x": 0.0, "y": 0.0, "z": 1.0},
        "center": {"x": 0.0, "y": 0.0, "z": -0.1},
    }
