"""Decide whether a rig needs two parameter sets, and which files to use now.

Two sets are needed where, on fresh bars, the refined set is more than 10 % worse than the 2D set in
mean reprojection error, or than the 3D set in mean length error. The forecast (`predictive`) judges
all three on the same simulated images, so that the verdict is its share of draws. It is right as
far as the model is: errors on held-out frames are compared with the forecast (`model_check`), and
where they are larger, the verdict says so and does not decide for one set. For two it still does:
what the model lacks makes one set worse, not better (right in all 6 simulated rigs looked at).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.system.numbers import digits
from stereocal.verdict.intervals import TAILS
from stereocal.verdict.model_check import ModelCheck
from stereocal.verdict.predictive import Predictive

TOLERANCE = 0.10
"""One set is sufficient if its errors exceed those of the specialised sets by at most this
fraction."""
SURE = 0.975
"""Share of the draws that decides."""
MAXIMUM_TO_ADD = 10
"""Largest number of frames to add that is reported, as a multiple of the present number."""
SETS: tuple[Method, ...] = ("2d", "3d", "refined")
Kind = Literal["one", "two", "level"]


@dataclass(frozen=True)
class Verdict:
    """The verdict and the numbers behind it; its sentences are those of the `recommendation`."""

    kind: Kind
    figures: str
    """The expected errors of the sets on similar bars, for the user."""
    matching: Estimate
    """Refined over 2D set, mean reprojection error."""
    measuring: Estimate
    """Refined over 3D set, mean length error."""
    chance_of_one: float
    """Share of the draws in which one set does both jobs."""
    match_with: Method
    measure_with: Method
    frames_to_add: int | None
    """For `level`: approximate number of further frames that would decide; None if more than
    `MAXIMUM_TO_ADD` times the present number, or if nothing is to be decided."""
    check: ModelCheck | None
    """None if there are too few frames for one."""


def verdict(predictive: Predictive, frames: int, check: ModelCheck | None = None) -> Verdict:
    """The verdict of a forecast.

    Args:
        predictive: of all files, the refined one among them.
        frames: number of frames of the calibration.
        check: of the model behind the forecast.
    """
    if not set(SETS) <= set(predictive.methods):
        raise StereocalError("A verdict needs the 2D, the 3D and the refined set.")
    in_images = predictive.ratio(predictive.correct_px, "refined", "2d")
    in_length = predictive.ratio(predictive.mean_errors_3d, "refined", "3d")
    limit = 1.0 + TOLERANCE
    matching, measuring = (
        Estimate(float(value), float(low), float(high))
        for low, value, high in (
            np.nanpercentile(draws, (TAILS[0], 50, TAILS[1])) for draws in (in_images, in_length)
        )
    )
    chance = float(np.mean((in_images <= limit) & (in_length <= limit)))
    surely_one = chance >= SURE and (check is None or check.holds)
    kind: Kind = "two" if chance <= 1.0 - SURE else "one" if surely_one else "level"
    match_with: Method = "2d" if matching.value > limit else "refined"
    measure_with: Method = "3d" if measuring.value > limit else "refined"
    add = _frames_to_add((matching, measuring), frames) if kind == "level" else None
    figures = _figures(predictive, matching, measuring)
    return Verdict(kind, figures, matching, measuring, chance, match_with, measure_with, add, check)


def sure(chance: float) -> str:
    """A probability, for the user."""
    return "more than 99 %" if chance > 0.99 else f"{100 * chance:.0f} %"


def _figures(predictive: Predictive, matching: Estimate, measuring: Estimate) -> str:
    of = predictive.forecasts
    px = {name: f"{digits(of[name].mean_reprojection_px.value, 2)} px" for name in SETS}
    length = {name: f"{digits(100 * of[name].mean_error_3d.value, 2)} %" for name in SETS}
    times = [
        f"{ratio.value:.2f} times, {ratio.low:.2f} to {ratio.high:.2f}"
        for ratio in (matching, measuring)
    ]
    return (
        f"On similar bars, the refined set matches with an error of {px['refined']}, the 2D set "
        f"with {px['2d']} ({times[0]}); it measures with an error of {length['refined']}, the 3D "
        f"set with {length['3d']} ({times[1]})."
    )


def _frames_to_add(ratios: Sequence[Estimate], frames: int) -> int | None:
    """Number of additional frames after which no interval should contain the limit; None if many.

    The widths of the intervals are assumed to fall with the square root of the number of frames.
    """
    limit = np.log1p(TOLERANCE)
    needed = 1.0
    for ratio in ratios:
        if np.log(ratio.low) <= limit < np.log(ratio.high):
            side = ratio.high if np.log(ratio.value) <= limit else ratio.low
            half = abs(np.log(side / ratio.value))
            gap = abs(np.log(ratio.value) - limit)
            needed = max(needed, float(np.square(half / max(gap, 1e-9))))
    if needed > MAXIMUM_TO_ADD:
        return None
    return max(5 * int(np.ceil((needed - 1.0) * frames / 5)), 5)
