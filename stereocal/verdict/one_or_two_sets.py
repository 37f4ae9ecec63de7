"""Decide whether a rig needs two parameter sets, and which files to use now.

Two sets are needed where, on fresh bars, the refined set is more than 10 % worse than the 2D set in
mean reprojection error, or than the 3D set in mean length error. The forecast (`predictive`) judges
all three on the same simulated images, so that the verdict is its share of draws. It is right as
far as the model is: errors on held-out frames of random splits are held against the forecast, and
where they are larger, the verdict says so and does not decide for one set. For two it still does:
what the model lacks makes one set worse, not better (right in all 6 simulated rigs looked at).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stereocal.calibration.methods import ALL_METHODS, CalibrationSettings, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, Run, evaluate_run
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.verdict.predictive import TAILS, Predictive

TOLERANCE = 0.10
"""One set is sufficient if its errors exceed those of the specialised sets by at most this
fraction."""
SURE = 0.975
"""Share of the draws that decides."""
MINIMUM_RUNS = 10
MINIMUM_FITTED = 0.7
"""Share of the frames that a split must fit; sets of fewer frames say little about the file."""
MAXIMUM_TO_ADD = 10
"""Largest number of frames to add that is reported, as a multiple of the present number."""
HELD_OUT_LIMITS = (1.3, 1.6)
"""Error on held-out frames over the forecast, in the images and in length, from which on the model
is doubted. In sound rigs of 25 frames 1 in 100 exceeds them."""

CAUTIOUS_BELOW = 0.75
CAUTIOUS = (
    " The forecast of lengths is cautious here: it takes the noise along the epipolar lines to be "
    "as large as across them, where a wrong distortion or cameras out of step add to it."
)

SETS: tuple[Method, ...] = ("2d", "3d", "refined")
Kind = Literal["one", "two", "level"]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors of the three sets on the frames that one run held out; the first axis is `SETS`."""

    fitted_frames: int
    tested_frames: int
    matching_px: FloatArray
    """(3,): mean reprojection error of the correct pairs; NaN without pairs."""
    length: FloatArray
    """(3,): mean relative length error of the bars; NaN without bars."""


@dataclass(frozen=True)
class Ratio:
    """Error of the refined set over that of another set, with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class ModelCheck:
    """Errors of the refined set on held-out frames over the forecast ones."""

    matching: float
    measuring: float

    @property
    def holds(self) -> bool:
        """Whether neither is larger than in sound rigs."""
        return self.matching <= HELD_OUT_LIMITS[0] and self.measuring <= HELD_OUT_LIMITS[1]

    @property
    def text(self) -> str:
        """What was found, for the user."""
        if self.holds:
            found = (
                f"Checked on held-out frames: their errors are {self.matching:.2f} times the "
                f"forecast in the images and {self.measuring:.2f} times in length."
            )
            return found + CAUTIOUS if self.measuring < CAUTIOUS_BELOW else found
        return (
            f"Errors on held-out frames are {self.matching:.2f} times the forecast in the images "
            f"and {self.measuring:.2f} times in length: the model does not explain these images. "
            "Likely causes: a wrong distortion, a lens file too sure of itself, a bar that bends, "
            "cameras out of step. Until it is found, trust the errors on held-out frames."
        )


@dataclass(frozen=True)
class Verdict:
    """The verdict: its kind, a sentence for the user, and the numbers behind it."""

    kind: Kind
    text: str
    matching: Ratio
    """Refined over 2D set, mean reprojection error."""
    measuring: Ratio
    """Refined over 3D set, mean length error."""
    chance_of_one: float
    """Share of the draws in which one set does both jobs."""
    match_with: Method
    measure_with: Method
    frames_to_add: int | None
    """For `level`: approximate number of further frames that would decide; None if more than
    `MAXIMUM_TO_ADD` times the present number, or if nothing is to be decided."""
    check: ModelCheck | None
    """None if no splits were made."""


def verdict(predictive: Predictive, frames: int, runs: Sequence[HeldOut] = ()) -> Verdict:
    """The verdict of a forecast.

    Args:
        predictive: of all files, the refined one among them.
        frames: number of frames of the calibration.
        runs: random splits, for the check of the model; those that fit fewer than 7 of 10 frames,
            and fewer than 10 of them, are no check.

    Raises:
        StereocalError: the forecast has no refined file.
    """
    if not set(SETS) <= set(predictive.methods):
        raise StereocalError("A verdict needs the 2D, the 3D and the refined set.")
    in_images = predictive.ratio(predictive.correct_px, "refined", "2d")
    in_length = predictive.ratio(predictive.mean_errors_3d, "refined", "3d")
    limit = 1.0 + TOLERANCE
    matching, measuring = _ratio(in_images), _ratio(in_length)
    chance = float(np.mean((in_images <= limit) & (in_length <= limit)))
    usable = [run for run in runs if run.fitted_frames >= MINIMUM_FITTED * frames]
    check = check_model(predictive, usable) if len(usable) >= MINIMUM_RUNS else None
    kind: Kind = "level"
    if chance <= 1.0 - SURE:
        kind = "two"
    elif chance >= SURE and (check is None or check.holds):
        kind = "one"
    match_with: Method = "2d" if matching.value > limit else "refined"
    measure_with: Method = "3d" if measuring.value > limit else "refined"
    add = _frames_to_add((matching, measuring), frames) if kind == "level" else None
    parts = [
        _opening(kind, chance, match_with, measure_with, check is None or check.holds),
        _figures(predictive, matching, measuring),
    ]
    if kind == "level" and (check is None or check.holds):
        parts.append(
            f"About {add} more frames would decide it."
            if add
            else "More frames would hardly decide it, and little depends on it."
        )
    if check is not None and not check.holds:
        parts.append(check.text)
    return Verdict(
        kind, " ".join(parts), matching, measuring, chance, match_with, measure_with, add, check
    )


def check_model(predictive: Predictive, runs: Sequence[HeldOut]) -> ModelCheck:
    """Errors on held-out frames against the forecast of the refined file."""
    forecast = predictive.forecasts["refined"]
    at = SETS.index("refined")
    px = np.nanmean([run.matching_px[at] for run in runs])
    length = np.nanmean([run.length[at] for run in runs])
    return ModelCheck(
        float(px / forecast.mean_reprojection_px.value),
        float(length / forecast.mean_error_3d.value),
    )


def held_out(run: Run, dataset: Dataset, fitted_frames: int) -> HeldOut:
    """The errors of one validation run.

    Raises:
        StereocalError: the run does not include the refined method.
    """
    if len(run.angles) < len(ALL_METHODS):
        raise StereocalError("A verdict needs validation runs that include the refined method.")
    rows = [ALL_METHODS.index(name) for name in SETS]
    errors = np.abs(run.lengths[rows] - 1.0)
    known = np.isfinite(errors)
    with np.errstate(invalid="ignore"):
        length = np.where(known, errors, 0.0).sum(axis=1) / known.sum(axis=1)
    return HeldOut(
        fitted_frames=fitted_frames,
        tested_frames=len(dataset.correspondences.frames) - fitted_frames,
        matching_px=run.correct_px[rows],
        length=length,
    )


def run_splits(
    dataset: Dataset,
    settings: CalibrationSettings,
    refine_settings: RefineSettings,
    runs: int = 50,
    calibration_frames: int | None = None,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> list[HeldOut] | None:
    """The errors of `runs` random splits, the same ones as in a validation with this seed.

    Args:
        calibration_frames: 4 of 5 frames if None, as in the paper.
        progress: called with the number of finished runs and of all runs.
        cancelled: checked after each run.

    Returns:
        The errors of each run; None if cancelled.

    Raises:
        StereocalError: too few frames, or points that do not determine the pose.
    """
    frames = calibration_frames or (4 * len(dataset.correspondences.frames)) // 5
    validation = EvaluationSettings(settings, runs, frames, refine_settings)
    found = []
    for run in range(runs):
        found.append(held_out(evaluate_run(dataset, validation, 0, run), dataset, frames))
        if progress:
            progress(run + 1, runs)
        if cancelled and cancelled():
            return None
    return found


def _ratio(draws: FloatArray) -> Ratio:
    low, value, high = np.nanpercentile(draws, (TAILS[0], 50, TAILS[1]))
    return Ratio(float(value), float(low), float(high))


def _opening(
    kind: Kind, chance: float, match_with: Method, measure_with: Method, model_holds: bool
) -> str:
    names = {"2d": "the 2D set", "3d": "the 3D set", "refined": "the refined set"}
    match, measure = names[match_with], names[measure_with]
    use = f"Match with {match}, measure with {measure}."
    if match_with == measure_with:
        use = f"Match and measure with {match}."
    if kind == "one":
        return f"One refined set does both jobs ({sure(chance)} sure). {use}"
    if kind == "two":
        return f"Two sets are worth it on this rig ({sure(1 - chance)} sure). {use}"
    if not model_holds:
        return f"One set or two cannot be decided, since the forecast does not hold here. {use}"
    return (
        "One set or two is not decided on this rig: one does both jobs with a probability of "
        f"{100 * chance:.0f} %. {use}"
    )


def sure(chance: float) -> str:
    """A probability, for the user."""
    return "more than 99 %" if chance > 0.99 else f"{100 * chance:.0f} %"


def _figures(predictive: Predictive, matching: Ratio, measuring: Ratio) -> str:
    of = predictive.forecasts
    px = {name: of[name].mean_reprojection_px.value for name in SETS}
    length = {name: of[name].mean_error_3d.value for name in SETS}
    return (
        f"On bars like these, the refined set matches with an error of {px['refined']:.2f} px, the "
        f"2D set with {px['2d']:.2f} px ({_in_words(matching)}); it measures with an error of "
        f"{_percent(length['refined'])}, the 3D set with {_percent(length['3d'])} "
        f"({_in_words(measuring)})."
    )


def _frames_to_add(ratios: Sequence[Ratio], frames: int) -> int | None:
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


def _in_words(ratio: Ratio) -> str:
    return f"{ratio.value:.2f} times, {ratio.low:.2f} to {ratio.high:.2f}"


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2f} %"
