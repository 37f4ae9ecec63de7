"""Does this rig need two sets? The answer from random splits, with its uncertainty.

In each run, all methods are fitted to the same frames and tested on the others: the refined set
against the 2D set in matching (reprojection error of true pairs), and against the 3D set in
measuring (length error). Runs share frames; the interval of the mean log ratio is that of Nadeau
and Bengio (Machine Learning 52, 2003), whose variance is (1 / runs + tested / fitted) times the
variance between runs.
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
"""One set does both jobs where it is at most so much worse in each than that job's own set."""
LEVEL = 0.95
MINIMUM_RUNS = 10
MOST_TO_ADD = 10
"""More than ten times the frames are not worth a number."""

SETS: tuple[Method, ...] = ("2d", "3d", "refined")
Kind = Literal["one", "two", "few"]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Errors of the three sets on the frames that one run held out. First axis: `SETS`."""

    fitted_frames: int
    tested_frames: int
    matching_px: FloatArray
    """(3,): mean reprojection error of the true pairs; NaN without one."""
    length: FloatArray
    """(3,): mean relative length error of the bars; NaN without one."""


@dataclass(frozen=True)
class Ratio:
    """Error of the refined set over that of another, with its 95 % interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Verdict:
    """The answer, as a word, a sentence and its numbers."""

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
    """For `few`: about so many more frames would tell; None for more than can be said."""


def held_out(run: Run, dataset: Dataset, fitted_frames: int) -> HeldOut:
    """The figures of one run of an evaluation that includes the refined method.

    Raises:
        StereocalError: it does not.
    """
    if len(run.angles) < len(ALL_METHODS):
        raise StereocalError("A verdict needs runs with the refined method.")
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
    """The figures of so many random splits: those that an evaluation with this seed draws.

    Args:
        calibration_frames: 4 of 5 frames when not given, as in the paper.

    Returns None when cancelled.

    Raises:
        StereocalError: too few frames, or points that allow no calibration.
    """
    frames = calibration_frames or (4 * len(dataset.correspondences.frames)) // 5
    protocol = EvaluationSettings(settings, runs, frames, refine_settings)
    found = []
    for run in range(runs):
        found.append(held_out(evaluate_run(dataset, protocol, 0, run), dataset, frames))
        if progress:
            progress(run + 1, runs)
        if cancelled and cancelled():
            return None
    return found


def verdict(runs: Sequence[HeldOut]) -> Verdict:
    """The answer of so many runs on one data set.

    Raises:
        StereocalError: fewer than 10 runs, or runs without a bar or a pair to test.
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
        f"the refined set matches with {px[2]:.2f} px where the 2D set has {px[0]:.2f} px "
        f"({_words(matching)}), and measures with {_percent(share[2])} where the 3D set has "
        f"{_percent(share[1])} ({_words(measuring)})."
    )
    more = f"about {add}" if add else f"more than {MOST_TO_ADD * (fitted + tested)}"
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
            "Too few runs have both a pair and a bar to test with: the held-out frames must show "
            "both targets."
        )
    mean = float(logs.mean())
    spread = float(logs.std(ddof=1)) * np.sqrt(1.0 / len(logs) + tested_to_fitted)
    half = float(stdtrit(len(logs) - 1, 0.5 + 0.5 * LEVEL)) * spread
    return Ratio(float(np.exp(mean)), float(np.exp(mean - half)), float(np.exp(mean + half)))


def _frames_to_add(ratios: Sequence[Ratio], frames: int) -> int | None:
    """So many more that each interval, narrowing with the root of the frames, leaves the limit."""
    limit = np.log1p(TOLERANCE)
    needed = 1.0
    for ratio in ratios:
        half = np.log(ratio.high / ratio.value)
        if np.log(ratio.low) <= limit < np.log(ratio.high):
            gap = abs(np.log(ratio.value) - limit)
            needed = max(needed, float(np.square(half / max(gap, 1e-9))))
    if needed > MOST_TO_ADD:
        return None
    return max(5 * int(np.ceil((needed - 1.0) * frames / 5)), 5)


def _words(ratio: Ratio) -> str:
    return f"{ratio.value:.2f} times, {ratio.low:.2f} to {ratio.high:.2f}"


def _percent(fraction: float) -> str:
    return f"{100 * fraction:.2f} %"
