"""The size of the targets of the bar, 2x2 checkerboards, that detection finds."""

import math
from dataclasses import dataclass, replace

from stereocal.errors import StereocalError
from stereocal.field.planning.plan import Plan
from stereocal.field.printing.prints import SMALLEST_M
from stereocal.system.numbers import rounded

GOOD_PX = 50.0
"""A target of this width or more is located well also when it is tilted by 60 degrees."""
DETECTED_PX = (20.0, 400.0)
"""Width of the targets that detection is made for."""
STEP_MM, FINE_STEP_MM, FINE_MM = 5.0, 1.0, 50.0
"""Sides are rounded up to a multiple of the step, of the finer one below 50 mm."""
SEPARATION = 1.6
"""Least distance of the targets across the line of sight, in sides of a target, so that neither
hides the other."""


@dataclass(frozen=True)
class TargetSize:
    """A target of 2x2 squares, and how large it appears at the least and the largest distance of
    the bar; `focal_px` is the smaller one of two cameras.
    """

    side_m: float
    focal_px: float
    near_m: float
    far_m: float
    bar_m: float | None = None
    """Distance between the two targets, if it is known."""

    def _px_at(self, distance_m: float) -> float:
        return self.focal_px * self.side_m / distance_m

    @property
    def sentence(self) -> str:
        """How large the target appears, and what to do if that is too large or too small."""
        seen = f"A target of {rounded(1e3 * self.side_m, 4)} mm is {' and '.join(self.widths)}."
        return " ".join([seen, *self.advice])

    @property
    def widths(self) -> list[str]:
        """Width and distance in words, at the far end and, if it is another, at the near end."""
        words = [f"{self._px_at(self.far_m):.0f} px across at {rounded(self.far_m, 4)} m"]
        if self.near_m < self.far_m:
            words.append(f"{self._px_at(self.near_m):.0f} px at {rounded(self.near_m, 4)} m")
        return words

    @property
    def advice(self) -> list[str]:
        """What to do if the target is too small, too large, or too large for the bar."""
        least, most = DETECTED_PX
        sentences = []
        if self._px_at(self.far_m) < least:
            sentences.append(f"Detection needs at least {least:.0f} px: print larger targets.")
        if self._px_at(self.near_m) > most:
            sentences.append(
                f"Detection finds targets of up to {most:.0f} px: keep the bar beyond "
                f"{rounded(self.focal_px * self.side_m / most, 3)} m, or print smaller targets."
            )
        if self.bar_m is not None and self.bar_m < SEPARATION * self.side_m:
            sentences.append(
                f"On a bar of {rounded(self.bar_m, 4)} m they hide each other: take a bar of at "
                f"least {rounded(SEPARATION * self.side_m)} m, or smaller targets."
            )
        return sentences


def target_size(
    focal_px: float, near_m: float, far_m: float, least_px: float = GOOD_PX
) -> TargetSize:
    """The smallest target that is `least_px` wide at the far end."""
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
