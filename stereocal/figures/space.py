"""Common parts of 3D figures: upright axes of equal scale, and a viewpoint that shows the scene."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import GRID_3D, TRANSPARENT
from stereocal.rig.compiled import FloatArray

EYE_OF_DIAGONAL = 1.25
"""Distance of the eye over the scene's diagonal; also suitable for narrow screens."""
BEHIND = (0.5, -0.42, -0.76)
"""Behind, right of and above the primary camera."""
AXIS_TITLES = {"xaxis": "x (m)", "yaxis": "z (m), depth", "zaxis": "−y (m), up"}


def upright(points: FloatArray) -> dict[str, FloatArray]:
    """Points (..., 3) in the primary's frame, as the figure's coordinates: x, depth, up."""
    return {
        "x": points[..., 0].ravel(), "y": points[..., 2].ravel(), "z": -points[..., 1].ravel()
    }  # fmt: skip


@dataclass(frozen=True, eq=False)
class Eye:
    """From where a scene is seen, in the primary's frame, metres."""

    towards: FloatArray
    """(3,): what is in the middle of the view."""
    direction: tuple[float, float, float] = BEHIND
    """From `towards` to the eye, which is as far away as needed to see everything."""
    at: FloatArray | None = None
    """(3,): the eye itself, instead of a direction."""
    up: tuple[float, float, float] = (0.0, -1.0, 0.0)
    """What is up in the view."""


def set_scene(figure: go.Figure, eye: Eye | None = None) -> None:
    """Set equal axes in metres, and a viewpoint; without one everything is seen from behind."""
    axis = {
        "showbackground": False, "gridcolor": GRID_3D, "linecolor": GRID_3D, "zeroline": False,
        "nticks": 6, "tickfont": {"size": 12}, "showspikes": False,
    }  # fmt: skip
    low, high = _bounds(figure)
    figure.update_layout(
        scene={
            "aspectmode": "data",
            "camera": _view(low, high, eye),
            "bgcolor": TRANSPARENT,
            **{
                name: {
                    **axis, "range": [low[at], high[at]],
                    "title": {"text": title, "font": {"size": 14}},
                }
                for at, (name, title) in enumerate(AXIS_TITLES.items())
            },
        }
    )  # fmt: skip


def _bounds(figure: go.Figure) -> tuple[FloatArray, FloatArray]:
    """(3,) each: the ranges of the axes, with a margin of 2 % of the largest."""
    values = [np.concatenate([trace[axis] for trace in figure.data]) for axis in "xyz"]
    known = [each[np.isfinite(each)] for each in values]
    low, high = (np.array([pick(each) for each in known]) for pick in (np.min, np.max))
    margin = 0.02 * (high - low).max()
    return low - margin, high + margin


def _view(low: FloatArray, high: FloatArray, eye: Eye | None) -> dict[str, dict[str, float]]:
    """Plotly's camera. Its unit is the geometric mean of the axes, its origin their middle."""
    middle, unit = 0.5 * (low + high), float(np.cbrt(np.prod(high - low)))
    distance = EYE_OF_DIAGONAL * float(np.linalg.norm(high - low))
    if eye is None:
        eye = Eye(np.array([middle[0], -middle[2], middle[1]]))
    towards = _upright(eye.towards)
    at = towards + distance * _upright(np.array(eye.direction))
    if eye.at is not None:
        at = _upright(eye.at)
    names = ("x", "y", "z")
    return {
        "eye": dict(zip(names, ((at - middle) / unit).tolist(), strict=True)),
        "up": dict(zip(names, _upright(np.array(eye.up)).tolist(), strict=True)),
        "center": dict(zip(names, ((towards - middle) / unit).tolist(), strict=True)),
    }


def _upright(point: FloatArray) -> FloatArray:
    return np.array([point[0], point[2], -point[1]])
