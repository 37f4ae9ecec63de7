"""The plan from above, for the field sheet: cameras, what both see, and the places of the bar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import cv2
import numpy as np
from reportlab.graphics.shapes import Drawing, Group, Line, Polygon, String
from reportlab.lib.colors import Color, black, grey, lightgrey, white
from reportlab.lib.units import mm

from stereocal.field.planning.plan import Plan
from stereocal.field.printing.bar_places import BarPlace, ground_from_primary
from stereocal.field.printing.paper import FONT
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded

BORDER_MM, LABEL_MM = 6.0, 2.6
CAMERA_MM = 4.0
"""Length of the symbol of a camera."""
NARROW_MM = 9.0
"""The least distance of the cameras' symbols with a label between them."""
COMMON_COLOUR = Color(0.91, 0.91, 0.91)
BAR_COLOUR = Color(0.0, 0.45, 0.70)


def draw_from_above(
    plan: Plan, places: Sequence[BarPlace], width_mm: float, height_mm: float
) -> Drawing:
    """Cameras below, far end above, all at one scale; each bar as it lies, seen from above."""
    ground = ground_from_primary(plan)
    cameras = ground.apply(np.vstack([np.zeros(3), plan.pose.inverse().T]))[:, [0, 2]]
    axes = np.vstack([ground.R[:, 2], ground.R @ plan.pose.R[2]])[:, [0, 2]]
    common = ground.apply(plan.common_points)[:, [0, 2]]
    to_mm = _Scale(np.vstack([cameras, common]), width_mm, height_mm)
    hull = cv2.convexHull(common.astype(np.float32))[:, 0].astype(np.float64)
    shapes = Group(_outline(to_mm(hull), COMMON_COLOUR))
    for camera, axis in zip(cameras, axes, strict=True):
        far = max(float(((common - camera) @ axis).max()), 0.0)  # end of the common view
        ahead = camera + far * axis
        line = _line(to_mm(camera), to_mm(ahead), grey, 0.15)
        line.strokeDashArray = [2.0, 1.0]
        shapes.add(line)
    for place in places:
        ends = to_mm(ground.apply(place.ends_m)[:, [0, 2]])
        if np.linalg.norm(ends[1] - ends[0]) < 1.0:  # upright, or small at this scale
            ends = ends.mean(axis=0) + np.array([[-0.5, 0.0], [0.5, 0.0]])
        shapes.add(_line(ends[0], ends[1], BAR_COLOUR, 0.7))
    _draw_cameras(shapes, to_mm(cameras), axes, f"{rounded(plan.baseline_m, 4)} m")
    depths = plan.common_points[:, 2]
    for depth in (depths.min(), depths.max()):
        there = common[depths == depth]
        right, up = to_mm(there[there[:, 0].argmax()])
        shapes.add(_label((right + 1.5, up - 0.8), f"{rounded(depth, 3)} m", "start"))
    drawing = Drawing(width_mm * mm, height_mm * mm)
    drawing.add(Group(shapes, transform=(mm, 0, 0, mm, 0, 0)))
    return drawing


class _Scale:
    """From metres (right, ahead) to mm on the drawing, with the same scale both ways."""

    def __init__(self, points_m: FloatArray, width_mm: float, height_mm: float) -> None:
        lowest, highest = points_m.min(axis=0), points_m.max(axis=0)
        room = np.array([width_mm - 3 * BORDER_MM, height_mm - 2 * BORDER_MM])
        self._scale = float(np.min(room / np.maximum(highest - lowest, 1e-9)))
        self._middle = 0.5 * (lowest + highest)
        self._centre = 0.5 * np.array([width_mm - BORDER_MM, height_mm + 0.5 * BORDER_MM])

    def __call__(self, points_m: FloatArray) -> FloatArray:
        return np.asarray(self._centre + self._scale * (points_m - self._middle))


def _draw_cameras(shapes: Group, places: FloatArray, axes: FloatArray, baseline: str) -> None:
    """Both cameras, the line between them, and its length; beside them if they are too close."""
    first, second = places
    shapes.add(_line(first, second, black, 0.2))
    for at, axis in zip(places, axes, strict=True):
        shapes.add(_camera(at, axis))
    middle = 0.5 * (first + second)
    if np.linalg.norm(second - first) < NARROW_MM:
        shapes.add(_label((middle[0] + CAMERA_MM, middle[1]), f"P and S, {baseline}", "start"))
        return
    shapes.add(_label((middle[0], middle[1] + 0.8), baseline, "middle"))
    for name, at in zip("PS", places, strict=True):
        shapes.add(_label((at[0], at[1] - CAMERA_MM - 0.5), name, "middle"))


def _camera(at: FloatArray, axis: FloatArray) -> Polygon:
    """A triangle that opens in the direction in which the camera looks."""
    length = float(np.linalg.norm(axis))
    ahead = axis / length if length > 1e-6 else np.array([0.0, 1.0])
    across = np.array([ahead[1], -ahead[0]])
    corners = np.array(
        [
            at - CAMERA_MM * 0.5 * ahead,
            at + CAMERA_MM * 0.5 * ahead + 1.6 * across,
            at + CAMERA_MM * 0.5 * ahead - 1.6 * across,
        ]
    )
    return _outline(corners, white, black)


def _outline(points: FloatArray, fill: Color, colour: Color = lightgrey) -> Polygon:
    return Polygon(points.ravel().tolist(), fillColor=fill, strokeColor=colour, strokeWidth=0.2)


def _line(start: FloatArray, end: FloatArray, colour: Color, width: float) -> Line:
    x1, y1, x2, y2 = (float(value) for value in (*start, *end))
    return Line(x1, y1, x2, y2, strokeColor=colour, strokeWidth=width)


def _label(
    at: FloatArray | tuple[float, float], words: str, anchor: Literal["start", "middle"]
) -> String:
    return String(
        float(at[0]),
        float(at[1]),
        words,
        fontName=FONT,
        fontSize=LABEL_MM,
        textAnchor=anchor,
        fillColor=black,
    )
