"""How well each method matches and measures on frames it has not seen (paper, Section 6).

A run draws k of n frames, calibrates with them, and tests on the others: every point of the primary
camera against every point of the secondary. Pairs of the same target in the same frame are correct,
all others wrong: 10 and 90 for 5 frames. Beyond `MOST_PARTNERS` points, each point meets only so
many wrong partners, drawn at random: the cost grows with the frames and not with their square.

Errors are not kept but counted, in bins of log10; pooling runs and data sets adds counts. A value
of 0 counts as below all bins, and a pair that cannot be reconstructed in front of both cameras
(NaN) as above all bins: nobody would match it. Both are counted and reported.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from stereocal.calibrate import (
    CalibrationSettings,
    reconstruction_problem,
    reprojection_problem,
)
from stereocal.checks import check_points
from stereocal.compiled import BoolArray, FloatArray, IntArray, compiled
from stereocal.dataset import Dataset
from stereocal.errors import StereocalError
from stereocal.essential import calibrate_essential
from stereocal.geometry import Pose, reprojection_shift
from stereocal.montecarlo import minimise

LOWEST, HIGHEST, FINE = -12.0, 6.0, 0.02
"""Range of the fine bins in log10, and their width."""
BINS = round((HIGHEST - LOWEST) / FINE)
BELOW, ABOVE = BINS, BINS + 1
"""Two further counters: too small or zero, and too large or not to be reconstructed."""
MOST_PARTNERS = 99
MINIMUM_VALIDATION_FRAMES = 2
RESIDUAL, REPROJECTION = 0, 1
WRONG, CORRECT = 0, 1
CountArray = npt.NDArray[np.int64]


@dataclass(frozen=True)
class EvaluationSettings:
    """The protocol; the defaults are the paper's.

    Raises:
        StereocalError: a number below 1.
    """

    calibration: CalibrationSettings = field(default_factory=CalibrationSettings)
    runs: int = 100
    calibration_frames: int = 20

    def __post_init__(self) -> None:
        if self.runs < 1 or self.calibration_frames < 1:
            raise StereocalError("The runs and the calibration frames must be at least 1.")

    def to_json(self) -> dict[str, Any]:
        """All settings in one flat object."""
        return {
            **self.calibration.to_json(),
            "runs": self.runs,
            "calibration_frames": self.calibration_frames,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> EvaluationSettings:
        """The settings that `to_json` describes.

        Raises:
            StereocalError: a name that is no setting, or a value out of range.
        """
        rest = dict(data)
        own = {name: rest.pop(name) for name in ("runs", "calibration_frames") if name in rest}
        return cls(CalibrationSettings.from_json(rest), **own)


@dataclass(frozen=True, eq=False)
class Run:
    """What one run counted. First axis: the methods, in the order of `METHODS`."""

    counts: CountArray
    """(3, 2, 2, BINS + 2): method; residual, reprojection; wrong, correct; bin."""
    nans: CountArray
    """(3, 2): pairs not reconstructed in front of both cameras; wrong, correct."""
    lengths: FloatArray
    """(3, m): D^R / D of the validation bars; NaN where there is none."""
    angles: FloatArray
    """(3, 5), in radians."""


def evaluate_run(dataset: Dataset, settings: EvaluationSettings, number: int, run: int) -> Run:
    """Run `run` of the data set that stands at place `number` of the study.

    The random numbers depend on the seed, the data set's place and the run alone, so any engine
    gives the same result.

    Raises:
        StereocalError: too few frames, or points that allow no calibration.
    """
    search = settings.calibration.search
    seeds = np.random.SeedSequence([search.seed, number, run]).spawn(4)
    fit = split(dataset, settings.calibration_frames, seeds[0])
    check_points(dataset, fit)
    reprojection = reprojection_problem(dataset, fit)
    reconstruction = reconstruction_problem(dataset, settings.calibration.known_points, fit)
    start = calibrate_essential(
        reprojection.rays,
        dataset.baseline_m,
        settings.calibration.essential,
        reconstruction.cost,
    )
    poses = [
        start.pose,
        minimise(reprojection, start.pose, search, seeds[1]).pose,
        minimise(reconstruction, start.pose, search, seeds[2]).pose,
    ]
    return _test(dataset, ~fit, poses, np.random.Generator(np.random.PCG64(seeds[3])))


def split(dataset: Dataset, calibration_frames: int, seed: np.random.SeedSequence) -> BoolArray:
    """Which rows to fit, (n,); the frames are drawn at random, and the other rows are the test.

    Raises:
        StereocalError: fewer than 2 frames are left to test with.
    """
    check_split(dataset, calibration_frames)
    rows = dataset.correspondences
    order = np.random.Generator(np.random.PCG64(seed)).permutation(rows.frames)
    return np.isin(rows.frame, order[:calibration_frames])


def check_split(dataset: Dataset, calibration_frames: int) -> None:
    """Refuse a split that leaves nothing to test with.

    Raises:
        StereocalError: as said.
    """
    frames = len(dataset.correspondences.frames)
    if frames - calibration_frames < MINIMUM_VALIDATION_FRAMES:
        raise StereocalError(
            f"{dataset.name} has {frames} frames; with {calibration_frames} to calibrate, "
            f"{max(0, frames - calibration_frames)} are left to test, and at least "
            f"{MINIMUM_VALIDATION_FRAMES} are needed. Calibrate with fewer frames."
        )


def _test(
    dataset: Dataset, test: BoolArray, poses: Sequence[Pose], rng: np.random.Generator
) -> Run:
    counts = np.zeros((len(poses), 2, 2, BINS + 2), dtype=np.int64)
    nans = np.zeros((len(poses), 2), dtype=np.int64)
    rays = np.ascontiguousarray(dataset.rays[:, test])
    partners = _partners(rays.shape[1], rng)
    bars = dataset.bars_among(test)
    lengths = np.empty((len(poses), np.count_nonzero(bars)))
    for at, pose in enumerate(poses):
        count_pairs(
            pose.R, pose.T, pose.essential, rays, dataset.pixel_scale, partners,
            counts[at], nans[at],
        )  # fmt: skip
        lengths[at] = (dataset.reconstructed_lengths_m(pose) / dataset.bar_distances_m)[bars]
    return Run(counts, nans, lengths, np.array([pose.angles for pose in poses]))


def _partners(points: int, rng: np.random.Generator) -> IntArray:
    """(points, p): the secondary points that each primary point meets, itself first."""
    steps = np.arange(1, points)
    if len(steps) > MOST_PARTNERS:
        steps = rng.choice(steps, MOST_PARTNERS, replace=False)
    own = np.arange(points)[:, None]
    return np.asarray((own + np.concatenate([[0], steps])) % points, dtype=np.int64)


@compiled
def count_pairs(
    R: FloatArray,
    T: FloatArray,
    E: FloatArray,
    rays: FloatArray,
    pixel_scale: FloatArray,
    partners: IntArray,
    counts: CountArray,
    nans: CountArray,
) -> None:
    """Add |residual| and reprojection error of all pairs to `counts`, and the NaN to `nans`."""
    xp, yp, xs, ys = rays[0], rays[1], rays[2], rays[3]
    for i in range(partners.shape[0]):
        a = E[0, 0] * xp[i] + E[0, 1] * yp[i] + E[0, 2]
        b = E[1, 0] * xp[i] + E[1, 1] * yp[i] + E[1, 2]
        c = E[2, 0] * xp[i] + E[2, 1] * yp[i] + E[2, 2]
        for k in range(partners.shape[1]):
            j = partners[i, k]
            label = CORRECT if i == j else WRONG
            counts[RESIDUAL, label, _bin_of(abs(xs[j] * a + ys[j] * b + c))] += 1
            first, second = reprojection_shift(R, T, xp[i], yp[i], xs[j], ys[j], pixel_scale)
            error = 0.5 * (first + second)
            if np.isnan(error):
                nans[label] += 1
            counts[REPROJECTION, label, _bin_of(error)] += 1


@compiled
def _bin_of(value: float) -> int:
    if np.isnan(value):
        return ABOVE
    if value <= 0.0:
        return BELOW
    place = np.floor((np.log10(value) - LOWEST) / FINE)
    if place < 0.0:
        return BELOW
    return ABOVE if place >= BINS else int(place)


def evaluate(
    datasets: Sequence[Dataset],
    settings: EvaluationSettings,
    executor: Executor,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
    chunk: int = 10,
) -> list[list[Run]] | None:
    """All runs of all data sets, by data set, on any `concurrent.futures` executor.

    Args:
        progress: called with the runs done and the runs in all.
        cancelled: asked after each chunk of runs; if true, what is left is dropped.

    Returns:
        The runs by data set, in order; None if cancelled.

    Raises:
        StereocalError: a data set that allows no calibration, or a split that leaves no test.
    """
    for dataset in datasets:
        check_split(dataset, settings.calibration_frames)
    jobs: dict[Future[list[Run]], tuple[int, int]] = {}
    for number, dataset in enumerate(datasets):
        for first in range(0, settings.runs, chunk):
            runs = range(first, min(first + chunk, settings.runs))
            jobs[executor.submit(evaluate_runs, dataset, settings, number, runs)] = (number, first)
    found: dict[tuple[int, int], list[Run]] = {}
    done, total = 0, settings.runs * len(datasets)
    try:
        for future in as_completed(jobs):
            found[jobs[future]] = future.result()
            done += len(found[jobs[future]])
            if progress:
                progress(done, total)
            if cancelled and cancelled():
                return None
    finally:
        for future in jobs:
            future.cancel()
    return [
        [run for key in sorted(found) if key[0] == number for run in found[key]]
        for number in range(len(datasets))
    ]


def evaluate_runs(
    dataset: Dataset, settings: EvaluationSettings, number: int, runs: Sequence[int]
) -> list[Run]:
    """Several runs of one data set: the piece of work that an executor gets."""
    return [evaluate_run(dataset, settings, number, run) for run in runs]
