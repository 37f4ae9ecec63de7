"""The targets of the bar to print: 2x2 checkerboards of a size that detection finds."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace

from reportlab.graphics.shapes import Group

from stereocal.errors import StereocalError
from stereocal.field.planning.plan import Plan
from stereocal.field.printing.paper import (
    ACTUAL_SIZE,
    MARGIN_MM,
    PAPERS,
    Paper,
    Sheet,
    block,
    footer,
    footer_height,
    stroke,
)
from stereocal.system.numbers import rounded

GOOD_PX = 50.0
"""A target of this width or more is located well also when it is tilted by 60 degrees."""
DETECTED_PX = (20.0, 400.0)
"""Width of the targets that detection is made for."""
STEP_MM, FINE_STEP_MM, FINE_MM = 5.0, 1.0, 50.0
"""Sides are rounded up to a multiple of the step, of the finer one below 50 mm."""
MARK_MM, MARK_GAP_MM = 3.5, 1.5
"""Length of a mark outside the target, and its distance from it."""
AROUND_MM = MARK_MM + MARK_GAP_MM
SEPARATION = 1.6
"""Least distance of the targets across the line of sight, in sides of a target, so that neither
hides the other."""
SMALLEST_M, LARGEST_M = 0.002, 10.0


@dataclass(frozen=True)
class TargetSize:
    """A target, and how large it appears.

    Args:
        side_m: side of the whole target, of 2x2 squares.
        focal_px: focal length; of two cameras, the smaller one.
        near_m, far_m: least and largest distance of the bar from the cameras.
        bar_m: distance between the two targets; None if it is not known.
    """

    side_m: float
    focal_px: float
    near_m: float
    far_m: float
    bar_m: float | None = None

    @property
    def widths_px(self) -> tuple[float, float]:
        """Width at the near and at the far end, seen frontally."""
        return self.focal_px * self.side_m / self.near_m, self.focal_px * self.side_m / self.far_m

    @property
    def sentence(self) -> str:
        """How large the target appears, and what to do if that is too large or too small."""
        seen = f"A target of {rounded(1e3 * self.side_m, 4)} mm is {' and '.join(self.widths)}."
        return " ".join([seen, *self.advice])

    @property
    def widths(self) -> list[str]:
        """Width and distance in words, at the far end and, if it is another, at the near end."""
        near, far = self.widths_px
        found = [f"{far:.0f} px across at {rounded(self.far_m, 4)} m"]
        if self.near_m < self.far_m:
            found.append(f"{near:.0f} px at {rounded(self.near_m, 4)} m")
        return found

    @property
    def advice(self) -> list[str]:
        """What to do if the target is too small, too large, or too large for the bar."""
        near, far = self.widths_px
        least, most = DETECTED_PX
        found = []
        if far < least:
            found.append(f"Detection needs at least {least:.0f} px: print larger targets.")
        if near > most:
            found.append(
                f"Detection finds targets of up to {most:.0f} px: keep the bar beyond "
                f"{rounded(self.focal_px * self.side_m / most, 3)} m, or print smaller targets."
            )
        if self.bar_m is not None and self.bar_m < SEPARATION * self.side_m:
            found.append(
                f"On a bar of {rounded(self.bar_m, 4)} m they hide each other: take a bar of at "
                f"least {rounded(SEPARATION * self.side_m)} m, or smaller targets."
            )
        return found


def target_size(
    focal_px: float, near_m: float, far_m: float, least_px: float = GOOD_PX
) -> TargetSize:
    """The smallest target that is `least_px` wide at the far end.

    Args:
        focal_px: the smaller focal length of the two cameras.
    """
    for name, value in (
        ("focal length in px", focal_px),
        ("near distance", near_m),
        ("far distance", far_m),
        ("width of the target in px", least_px),
    ):
        if not (math.isfinite(value) and value > 0):
            raise StereocalError(f"The {name} must be above 0, not {value:g}.")
    if near_m > far_m:
        raise StereocalError(f"The near distance {near_m:g} m is beyond the far one, {far_m:g} m.")
    needed_mm = max(1e3 * least_px * far_m / focal_px, 1e3 * SMALLEST_M)
    step_mm = STEP_MM if needed_mm > FINE_MM else FINE_STEP_MM
    return TargetSize(1e-3 * step_mm * math.ceil(needed_mm / step_mm), focal_px, near_m, far_m)


def planned_target(plan: Plan, least_px: float = GOOD_PX) -> TargetSize:
    """The target for a plan: large enough at the far end, in the camera that sees it smaller."""
    focal = min(float(camera.K[0, 0]) for camera in (plan.primary, plan.secondary))
    return replace(target_size(focal, plan.near_m, plan.far_m, least_px), bar_m=plan.bar_m)


def describe_target(side_m: float, focal_px: float) -> str:
    """At which distances a target of a size is found, and found well."""
    least, most = DETECTED_PX
    near, good, far = (focal_px * side_m / px for px in (most, GOOD_PX, least))
    return (
        f"With these lenses a target of {rounded(1e3 * side_m, 4)} mm is found from "
        f"{rounded(near, 3)} m (there {most:.0f} px across) to {rounded(far, 3)} m ({least:.0f} "
        f"px), and found well up to {rounded(good, 3)} m ({GOOD_PX:.0f} px)."
    )


def print_targets(side_m: float, paper: Paper) -> Sheet:
    """A sheet with both targets if they fit, else with one, which is printed twice.

    Both targets are alike: detection calls one A and the other B by where they are.

    Args:
        side_m: side of the whole target, of 2x2 squares.
    """
    if not SMALLEST_M <= side_m <= LARGEST_M:
        raise StereocalError(
            f"A target of {side_m:g} m cannot be printed: its side must be {SMALLEST_M:g} to "
            f"{LARGEST_M:g} m."
        )
    side = 1e3 * side_m
    for columns, rows in ((2, 1), (1, 2), (1, 1)):
        texts = _texts(side, columns * rows)
        for turned in paper.both_ways:
            bottom = footer_height(texts, turned.width_mm)
            across = _centres(turned.width_mm - 2.0 * MARGIN_MM, side, columns)
            up = _centres(turned.height_mm - MARGIN_MM - bottom, side, rows)
            if across and up:
                shapes = Group(footer(texts, turned.width_mm))
                for x, y in itertools.product(across, up):
                    shapes.add(_target(MARGIN_MM + x, bottom + y, side))
                return Sheet(f"Target of {rounded(side, 4)} mm", turned, shapes)
    raise StereocalError(_too_large(side, paper))


def largest_side(paper: Paper) -> float:
    """Side in metres of the largest target that fits on a paper, in whole steps of 5 mm."""
    bottom = footer_height(_texts(100.0, 1), paper.width_mm)
    room = min(paper.width_mm - 2.0 * MARGIN_MM, paper.height_mm - MARGIN_MM - bottom)
    return 1e-3 * STEP_MM * math.floor((room - 2.0 * AROUND_MM) / STEP_MM)


def _too_large(side: float, paper: Paper) -> str:
    fitting = [name for name, other in PAPERS.items() if 1e3 * largest_side(other) >= side]
    what = (
        f"print it on {fitting[0]}, in a copy shop if need be"
        if fitting
        else "paint it on a board, with edges that meet in one point"
    )
    return (
        f"A target of {rounded(side, 4)} mm does not fit on {paper.name}, which holds "
        f"{1e3 * largest_side(paper):.0f} mm: {what}."
    )


def _texts(side: float, count: int) -> list[str]:
    often = (
        "Two targets, one for each end of the bar"
        if count == 2
        else "Print this sheet twice: one target for each end of the bar"
    )
    return [
        f"stereocal target, {rounded(side, 4)} mm. {often}.",
        "Cut at the corner marks, and glue it to something flat and matt. The distance A-B of the "
        "bar is measured between the middles of the targets, where the four squares meet.",
        f"{ACTUAL_SIZE}, and the target {rounded(side, 4)} mm wide and high.",
    ]


def _centres(room: float, side: float, count: int) -> list[float]:
    """Where the targets have their centres along a length, evenly spread; empty if too short."""
    free = (room - count * side - (count + 1) * AROUND_MM) / (count + 1)
    step = side + AROUND_MM + free
    return [step * (place + 1) - 0.5 * side for place in range(count)] if free >= -1e-9 else []


def _target(x: float, y: float, side: float) -> Group:
    """Two black squares that meet in (x, y), with marks around to cut and to align by."""
    half = 0.5 * side
    shapes = Group(block(x - half, y, half, half), block(x, y - half, half, half))
    start, end = half + MARK_GAP_MM, half + MARK_GAP_MM + MARK_MM
    for sign in (-1.0, 1.0):
        for across in (-half, 0.0, half):
            shapes.add(stroke(x + across, y + sign * start, x + across, y + sign * end))
            shapes.add(stroke(x + sign * start, y + across, x + sign * end, y + across))
    return shapes
