"""The forecast of a plan in sentences."""

from __future__ import annotations

import numpy as np

from stereocal.field.planning.forecast import PlanForecast
from stereocal.system.numbers import rounded
from stereocal.verdict.in_words import distance, percent

LIMITS = {
    "image noise": "the noise of the image points",
    "calibration": "the number of bars to calibrate with",
    "lenses": "how well the lenses are known",
    "baseline": "the baseline",
}


def answer(found: PlanForecast) -> str:
    """What the plan will measure, how well, and what limits it."""
    depths, length, position = found.fit.by_depth
    known = np.flatnonzero(np.isfinite(length))
    middle, far = known[len(known) // 2], known[-1]
    return (
        f"Lengths to {percent(length[middle])} % at {rounded(depths[middle], 3)} m and "
        f"{percent(length[far])} % at {rounded(depths[far], 3)} m, positions to "
        f"{distance(float(position[middle]))} and {distance(float(position[far]))} (mean errors of "
        f"the refined set). About {points_per_frame(found)} points of a frame can be matched. "
        f"Limited by {LIMITS[found.advice.limited_by]}."
    )


def points_per_frame(found: PlanForecast) -> str:
    """How many points of a frame can be matched, with two digits at most."""
    value = found.points_per_frame.value
    if not value < 10_000:
        return "more than 10,000"
    return str(int(float(f"{value:.2g}"))) if value >= 10 else str(int(value))
