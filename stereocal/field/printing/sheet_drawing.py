"""The plan from above, for the field sheet: cameras, what both see, and the places of the bar."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import cv2
import numpy as np
from reportlab.graphics.shapes import Drawing, Group, Line, Polygon, String
from reportlab.lib.colors import Color, black, grey, lightgrey, white
from reportlab.lib.units import mm

from stereocal.field.planning.bars import BarPlace, ground_from_primary
from stereocal.field.planning.plan import Plan
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
    lowest, highest = (end(np.vstack([cameras, common]), axis=0) for end in (np.min, np.max))
    room = np.array([width_mm - 3 * BORDER_MM, height_mm - 2 * BORDER_MM])
    scale = float(np.min(room / np.maximum(highest - lowest, 1e-9)))
    centre = 0.5 * np.array([width_mm - BORDER_MM, height_mm + 0.5 * BORDER_MM])

    def to_mm(points_m: FloatArray) -> FloatArray:
        """From metres (right, ahead), with the same scale both ways."""
        return np.asarray(centre + scale * (points_m - 0.5 * (lowest + highest)))

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
        at = np.add(to_mm(there[there[:, 0].argmax()]), (1.5, -0.8))
        shapes.add(_label(at, f"{rounded(depth, 3)} m", "start"))
    drawing = Drawing(width_mm * mm, height_mm * mm)
    drawing.add(Group(shapes, transform=(mm, 0, 0, mm, 0, 0)))
    return drawing


def _draw_cameras(shapes: Group, places: FloatArray, axes: FloatArray, baseline: str) -> None:
    """Both cameras, the line between them, and its length; beside them if they are too close.

    A camera is a triangle that opens in the direction in which it looks.
    """
    first, second = places
    shapes.add(_line(first, second, black, 0.2))
    for at, axis in zip(places, axes, strict=True):
        length = float(np.linalg.norm(axis))
        ahead = axis / length if length > 1e-6 else np.array([0.0, 1.0])
        half, across = 0.5 * CAMERA_MM * ahead, 1.6 * np.array([ahead[1], -ahead[0]])
        corners = np.array([at - half, at + half + across, at + half - across])
        shapes.add(_outline(corners, white, black))
    middle = 0.5 * (first + second)
    if np.linalg.norm(second - first) < NARROW_MM:
        shapes.add(_label(np.add(middle, (CAMERA_MM, 0.0)), f"P and S, {baseline}", "start"))
        return
    shapes.add(_label(np.add(middle, (0.0, 0.8)), baseline, "middle"))
    for name, at in zip("PS", places, strict=True):
        shapes.add(_label(np.subtract(at, (0.0, CAMERA_MM + 0.5)), name, "middle"))


def _outline(points: FloatArray, fill: Color, colour: Color = lightgrey) -> Polygon:
    return Polygon(points.ravel().tolist(), fillColor=fill, strokeColor=colour, strokeWidth=0.2)


def _line(start: FloatArray, end: FloatArray, colour: Color, width: float) -> Line:
    return Line(*start.tolist(), *end.tolist(), strokeColor=colour, strokeWidth=width)


def _label(at: FloatArray, words: str, anchor: Literal["start", "middle"]) -> String:
    x, y = at.tolist()
    return String(x, y, words, fontName=FONT, fontSize=LABEL_MM, textAnchor=anchor, fillColor=black)
