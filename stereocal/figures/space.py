"""Common parts of 3D figures: upright axes of equal scale, viewpoints, and the two cameras."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import plotly.graph_objects as go

from stereocal.figures.style import GRID_3D, NEUTRAL, TRANSPARENT
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.rig import Rig

VIEWS = ("Behind", "Above", "Side", "Camera 1", "Camera 2")
"""From where the scene is seen; camera 1 is the primary."""
FRUSTUM_OF_DEPTH = 0.15
"""Depth of a drawn camera over the depth of the scene; at its true size it would be a dot."""

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


def eye_of(view: str, rig: Rig, target: FloatArray) -> Eye:
    """One of `VIEWS` of a scene around a point (3,), metres."""
    first, second = np.zeros(3), rig.pose.inverse().T
    if view.startswith("Camera"):
        return Eye(target, at=first if view == "Camera 1" else second)
    middle = 0.5 * (0.5 * (first + second) + target)
    if view == "Above":  # depth to the right, since figures are wide
        return Eye(middle, (0.0, -1.0, 0.0), up=(-1.0, 0.0, 0.0))
    return Eye(middle, (1.0, 0.0, 0.0) if view == "Side" else BEHIND)


def add_cameras(figure: go.Figure, rig: Rig, depth: float) -> None:
    """Draw both frusta with labelled optical centres, and the baseline.

    Args:
        depth: of the scene, metres: the frusta are drawn in proportion.
    """
    for name, camera, path in frusta(rig, depth):
        centre = path[0]
        figure.add_trace(
            go.Scatter3d(
                **upright(path), mode="lines", line={"color": NEUTRAL, "width": 4},
                hoverinfo="skip", showlegend=False, name=f"{name} camera",
            )
        )  # fmt: skip
        width, height = camera.image_size
        figure.add_trace(
            go.Scatter3d(
                **upright(centre), mode="markers+text", text=[name], textposition="bottom center",
                marker={"color": NEUTRAL, "size": 5}, textfont={"size": 14}, showlegend=False,
                hovertemplate=f"{name} camera, {width} × {height} px<br>x {centre[0]:.3f} m (right)"
                f", y {centre[1]:.3f} m (down), z {centre[2]:.3f} m (depth)<extra></extra>",
                name=f"optical centre, {name}",
            )
        )  # fmt: skip
    length = f"{rig.pose.baseline:.3f} m"
    figure.add_trace(
        go.Scatter3d(
            **upright(np.array([np.zeros(3), rig.pose.inverse().T])), mode="lines",
            line={"color": NEUTRAL, "width": 3, "dash": "dash"},
            hovertemplate=f"baseline {length}<extra></extra>", name=f"Baseline {length}",
        )
    )  # fmt: skip


def frusta(rig: Rig, depth: float) -> Iterator[tuple[str, Camera, FloatArray]]:
    """Name, camera and outline of each frustum in proportion to a depth in metres.

    An outline is a path (k, 3) with gaps of NaN, which begins at the optical centre.
    """
    size = FRUSTUM_OF_DEPTH * depth
    back = rig.pose.inverse()
    gap = np.full(3, np.nan)
    for name, camera, centre, (a, b, c, d) in (
        ("primary", rig.primary, np.zeros(3), _corners(rig.primary, size)),
        ("secondary", rig.secondary, back.T, back.apply(_corners(rig.secondary, size))),
    ):
        # From the centre round each side of the image.
        path = [centre, a, b, centre, gap, centre, c, d, centre, gap, b, c, gap, d, a]
        yield name, camera, np.array(path)


def _corners(camera: Camera, depth: float) -> FloatArray:
    """The four image corners (4, 3) at a depth, in the camera's frame, without distortion."""
    width, height = camera.image_size
    right, bottom = width - 0.5, height - 0.5
    pixels = np.array([[-0.5, -0.5, 1], [right, -0.5, 1], [right, bottom, 1], [-0.5, bottom, 1]])
    corners: FloatArray = depth * pixels @ np.linalg.inv(camera.K).T
    return corners


def set_scene(figure: go.Figure, eye: Eye | None = None) -> None:
    """Set equal axes in metres, and a viewpoint; without one everything is seen from behind."""
    axis = {
        "showbackground": False, "gridcolor": GRID_3D, "linecolor": GRID_3D, "zeroline": False,
        "nticks": 6, "tickfont": {"size": 12}, "showspikes": False,
    }  # fmt: skip
    low, high = _bounds(figure)
    # Set directly, because `update_layout` takes ten times as long.
    figure.layout.scene = {
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
    }  # fmt: skip


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
    if eye is None:
        eye = Eye(np.array([middle[0], -middle[2], middle[1]]))
    distance = EYE_OF_DIAGONAL * float(np.linalg.norm(high - low))
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
