"""Decide from random splits whether a rig needs two parameter sets, with confidence intervals.

In each run, all methods are fitted to the same frames and tested on the others. The refined set is
compared with the 2D set in matching (reprojection error of correct pairs), and with the 3D set in
measuring (length error). The runs share frames; the interval of the mean log ratio therefore uses
the corrected variance of Nadeau and Bengio (Machine Learning 52, 2003): (1 / runs + tested /
fitted) times the variance between runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from scipy.special import stdtrit

from stereocal.calibration.methods import ALL_METHODS, CalibrationSettings, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, Run, evaluate_run
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset

TOLERANCE = 0.10
"""One set is sufficient if its errors exceed those of the specialised sets by at most this
fraction."""
LEVEL = 0.95
MINIMUM_RUNS = 10
MAXIMUM_TO_ADD = 10
"""Largest number of frames to add that is reported, as a multiple of the present number."""

SETS: tuple[Method, ...] = ("2d", "3d", "refined")
Kind = Literal["one", "two", "few"]


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
class Verdict:
    """The verdict: its kind, a sentence for the user, and the numbers behind it."""

    kind: Kind
    text: str
    matching: Ratio
    """Refined over 2D set."""
    measuring: Ratio
    """Refined over 3D set."""
    matching_px: tuple[float, float, float]
    """Median over the runs, in the order of `SETS`."""
    length: tuple[float, float, float]
    frames_to_add: int | None
    """For `few`: approximate number of additional frames needed; None if more than
    `MAXIMUM_TO_ADD` times the present number."""


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


def verdict(runs: Sequence[HeldOut]) -> Verdict:
    """The verdict from the runs on one data set.

    Raises:
        StereocalError: fewer than 10 runs, or fewer than 10 with a bar and a pair to test.
    """
    if len(runs) < MINIMUM_RUNS:
        raise StereocalError(
            f"A verdict needs at least {MINIMUM_RUNS} runs; there are {len(runs)}."
        )
    matching_px = np.array([run.matching_px for run in runs])
    length = np.array([run.length for run in runs])
    fitted, tested = runs[0].fitted_frames, runs[0].tested_frames
    matching = _ratio(matching_px[:, 2] / matching_px[:, 0], tested / fitted)
    measuring = _ratio(length[:, 2] / length[:, 1], tested / fitted)
    limit = 1.0 + TOLERANCE
    kind: Kind = "few"
    if max(matching.high, measuring.high) <= limit:
        kind = "one"
    elif max(matching.low, measuring.low) > limit:
        kind = "two"
    add = _frames_to_add((matching, measuring), fitted + tested) if kind == "few" else None
    px, share = np.nanmedian(matching_px, axis=0), np.nanmedian(length, axis=0)
    figures = (
        f"the refined set matches with an error of {px[2]:.2f} px, the 2D set with {px[0]:.2f} px "
        f"({_in_words(matching)}); it measures with an error of {_percent(share[2])}, the 3D set "
        f"with {_percent(share[1])} ({_in_words(measuring)})."
    )
    more = f"about {add}" if add else f"more than {MAXIMUM_TO_ADD * (fitted + tested)}"
    opening = {
        "one": "One refined set does both jobs: ",
        "two": "Two sets are worth it on this rig: ",
        "few": f"Too few frames to tell: add {more}. So far ",
    }[kind]
    return Verdict(
        kind,
        opening + figures,
        matching,
        measuring,
        (float(px[0]), float(px[1]), float(px[2])),
        (float(share[0]), float(share[1]), float(share[2])),
        add,
    )


def _ratio(ratios: FloatArray, tested_to_fitted: float) -> Ratio:
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = np.log(ratios)
    logs = logs[np.isfinite(logs)]
    if len(logs) < MINIMUM_RUNS:
        raise StereocalError(
            "Too few runs have both a pair and a bar to test: record more frames that show both "
            "targets."
        )
    mean = float(logs.mean())
    spread = float(logs.std(ddof=1)) * np.sqrt(1.0 / len(logs) + tested_to_fitted)
    half = float(stdtrit(len(logs) - 1, 0.5 + 0.5 * LEVEL)) * spread
    return Ratio(float(np.exp(mean)), float(np.exp(mean - half)), float(np.exp(mean + half)))


def _frames_to_add(ratios: Sequence[Ratio], frames: int) -> int | None:
    """Number of additional frames after which no interval should contain the limit; None if many.

    The widths of the intervals are assumed to fall with the square root of the number of frames.
    """
    limit = np.log1p(TOLERANCE)
    needed = 1.0
    for ratio in ratios:
        half = np.log(ratio.high / ratio.value)
        if np.log(ratio.low) <= limit < np.log(ratio.high):
            gap = abs(np.log(ratio.value) - limit)
            needed = max(needed, float(np.square(half / max(gap, 1e-9))))
    if needed > MAXIMUM_TO_ADD:
        return None
    return max(5 * int(np.ceil((needed - 1.0) * frames / 5)), 5)


def _in_words(ratio: Ratio) -> str:
    return f"{ratio.value:.2f} times, {ratio.low:.2f} to {ratio.high:.2f}"


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2f} %"
