"""Validation on held-out frames by repeated random splits (paper, Section 6).

A run draws k of n frames, calibrates with them, and tests on the others: every point of the primary
camera is paired with every point of the secondary. Pairs of the same target in the same frame are
correct, all others wrong: 10 and 90 for 5 frames. With more than `MAXIMUM_PARTNERS` points, each
point gets only that number of random wrong partners, so that the cost grows linearly.

Errors are counted in bins of log10; runs and data sets are pooled by adding counts. Errors of 0
count in the underflow bin. Pairs that cannot be reconstructed in front of both cameras (NaN) count
in the overflow bin, because they would not be matched. The numbers of both are reported.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing, suppress
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import chain, zip_longest
from typing import Any, Literal, Self

import numpy as np

from stereocal.calibration.checks import check_enough_points
from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import minimise, reconstruction_problem, reprojection_problem
from stereocal.errors import StereocalError
from stereocal.evaluation.counting import BINS, count_pairs, count_pairs_behind_windows
from stereocal.fit.least_squares.distortion import lenses_of_cameras
from stereocal.fit.least_squares.small_steps import undistort_rays
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.camera import pixel_scales
from stereocal.rig.geometry import Angles, Pose, fill_essential, fill_pose, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, CountArray, FloatArray, IntArray
from stereocal.system.latest import once
from stereocal.system.numbers import count
from stereocal.system.settings import Settings, described, joined
from stereocal.system.tasks import Progress, Task, run_tasks

MAXIMUM_PARTNERS = 99
MINIMUM_VALIDATION_FRAMES = 2
MOST_RUNS_AT_ONCE, FRAMES_AT_ONCE = 10, 5000
"""Of one task, which holds a worker; 10 runs of 20,000 frames held it for minutes."""
Splits = Literal["runs", "frames"]
MOST_RUNS = 100_000
"""More would tell nothing new, and each run is kept in memory, 6 kB."""


@dataclass(frozen=True)
class EvaluationSettings(Settings):
    """Settings of the validation; the defaults are the paper's."""

    calibration: CalibrationSettings = joined(CalibrationSettings)
    runs: int = described(
        100,
        "Runs for each data set",
        "How often frames are drawn again. Paper: 100.",
        between=(1, MOST_RUNS),
        name="runs",
    )
    calibration_frames: int = described(
        20,
        "Frames to calibrate with, in each run",
        "Of each run. Paper: 20 of 25.",
        between=(1, 10**9),
        name="calibration frames",
    )
    splits: Splits = described(
        "runs",
        "Left out together",
        "Runs of frames or single frames. Neighbouring frames of a moving bar have alike errors: "
        "tested on one, a fit of the other looks better than it is. For frames taken one by one "
        "both are the same.",
        choices={"runs": "Whole runs of frames", "frames": "Single frames (paper)"},
        name="frames left out together",
    )
    refined: RefineSettings | None = described(
        None, "Settings of the refined method", name="settings of the refined set"
    )
    """None to validate only the paper's methods."""

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> Self:
        """Settings of a file; first versions had `splits` of single frames, and did not say so."""
        refined = data.get("refined")
        settings = super().from_json({"splits": "frames", **data, "refined": None})
        return replace(settings, refined=refined and RefineSettings.from_json(refined))

    def to_json(self) -> dict[str, Any]:
        """The settings, with those of the refined method under `refined`."""
        return {**super().to_json(), "refined": self.refined and self.refined.to_json()}


@dataclass(frozen=True, eq=False)
class RunCounts:
    """The counts of one run. The first axis is the methods, in the order of `ALL_METHODS`."""

    counts: CountArray
    """(methods, 2, 2, BINS + 2): method; residual, reprojection; wrong, correct; bin."""
    nans: IntArray
    """(methods, 2): pairs not reconstructed in front of both cameras; wrong, correct."""
    lengths: FloatArray
    """(methods, m): D^R / D of the validation bars; NaN if not reconstructed."""
    angles: FloatArray
    """(methods, 5), in radians; NaN if the refined method failed."""
    correct_px: FloatArray
    """(methods,): mean reprojection error of the correct pairs; NaN if none has a value."""


def evaluate_run(
    dataset: Pair,
    settings: EvaluationSettings,
    number: int,
    run: int,
    whole: "WholeFit | None" = None,
) -> RunCounts:
    """Compute run `run` of data set `number`.

    The random numbers depend only on the seed, `number` and `run`, so that every executor gives the
    same result (for the refined method to about 1e-9, since it stops at a tolerance).
    """
    calibration = settings.calibration
    seeds = np.random.SeedSequence([calibration.search.seed, number, run]).spawn(4)
    clusters = clusters_to_split(dataset) if settings.splits == "runs" else None
    fit = split(dataset, settings.calibration_frames, seeds[0], clusters)
    check_enough_points(dataset, fit)
    angles = paper_angles(dataset, fit, calibration, seeds[1], seeds[2])
    rng = np.random.Generator(np.random.PCG64(seeds[3]))
    partners = _partners(int(np.count_nonzero(~fit)), rng)
    counts = _test(dataset, ~fit, angles, partners)
    if settings.refined is None:
        return counts
    near = (whole or WholeFit(dataset, settings.refined)).result
    return stacked(counts, _refined(dataset, fit, angles[0], settings.refined, partners, near))


@dataclass(frozen=True, eq=False)
class WholeFit:
    """The refined fit of all frames, made when first asked for: where those of the runs start.

    From there a fit takes half the time. It ends at the same minimum as from elsewhere, so that it
    has learnt nothing of the held-out frames.
    """

    dataset: Pair
    settings: RefineSettings | None

    @cached_property
    def result(self) -> RefinedResult | None:
        """None without settings, or if the fit failed."""
        with suppress(StereocalError):
            return refine(self.dataset, self.settings) if self.settings else None
        return None


def clusters_to_split(dataset: Pair) -> IntArray | None:
    """(f,): the cluster of each frame; None for frames taken one by one.

    By a fit with the default settings, so that those of an evaluation do not change its splits.
    """
    sigmas = dataset.baseline_sigma_m, dataset.target_distance_sigma_m
    key = f"{dataset.sha256} {sigmas} {dataset.time_offset}"
    return once("clusters", key, lambda: _clusters_of_fit(dataset))


def _clusters_of_fit(dataset: Pair) -> IntArray | None:
    try:
        fit = refine(dataset)
    except StereocalError:
        return None
    if not fit.clusters.has_runs:
        return None
    # Frames that this fit leaves out belong to the frame before them.
    places = np.cumsum(~fit.outlying) - 1
    return np.asarray(fit.clusters.of_frames[np.maximum(places, 0)])


def paper_angles(
    dataset: Pair,
    rows: BoolArray,
    settings: CalibrationSettings,
    of_2d: np.random.SeedSequence,
    of_3d: np.random.SeedSequence,
) -> FloatArray:
    """The angles (3, 5) of the three methods, calibrated with the rows in the mask `rows` (n,)."""
    matching = reprojection_problem(dataset, rows)
    measuring = reconstruction_problem(dataset, settings.known_points, rows)
    start = calibrate_essential(
        matching.rays, dataset.baseline_m, settings.essential, measuring.cost
    ).pose
    searched = ((matching, of_2d), (measuring, of_3d))
    poses = (minimise(problem, start, settings.search, seed).pose for problem, seed in searched)
    return np.array([start.angles, *(pose.angles for pose in poses)])


def split(
    dataset: Pair,
    calibration_frames: int,
    seed: np.random.SeedSequence,
    clusters: IntArray | None = None,
) -> BoolArray:
    """Mask (n,) of the rows of randomly drawn calibration frames; the other rows are the test.

    Args:
        calibration_frames: with clusters, an upper limit: whole clusters, at least one.
        clusters: (f,): of the frames, which are drawn together; None to draw frame by frame.
    """
    check_split(dataset, calibration_frames)
    rows = dataset.correspondences
    frames = len(rows.frames)
    chosen = np.zeros(frames, dtype=np.bool_)
    rng = np.random.Generator(np.random.PCG64(seed))
    if clusters is None:
        chosen[rng.permutation(frames)[:calibration_frames]] = True
    else:
        sizes = np.bincount(clusters)
        order = rng.permutation(len(sizes))
        fitting = np.cumsum(sizes[order]) <= calibration_frames
        fitting[0] = True
        chosen = np.isin(clusters, order[fitting])
    return chosen[np.searchsorted(rows.frames, rows.frame)]


def check_split(dataset: Pair, calibration_frames: int) -> None:
    """Check that a split leaves enough frames for the test."""
    frames = len(dataset.correspondences.frames)
    if frames - calibration_frames < MINIMUM_VALIDATION_FRAMES:
        raise StereocalError(
            f"{dataset.name} has {count(frames, 'frame')}; with {calibration_frames} to calibrate, "
            f"{max(0, frames - calibration_frames)} are left to test, and at least "
            f"{MINIMUM_VALIDATION_FRAMES} are needed. Calibrate with fewer frames."
        )


def _refined(
    dataset: Pair,
    fit: BoolArray,
    start: FloatArray,
    settings: RefineSettings,
    partners: IntArray,
    near: RefinedResult | None,
) -> RunCounts:
    """The refined method, fitted to the rows in `fit` (n,) and tested on the others.

    It is tested with its own lenses. If it fails, all values are NaN.
    """
    pose = Pose.from_angles(Angles(*start.tolist()), dataset.baseline_m)
    try:
        refined = refine(dataset, settings, pose, fit, near)
    except StereocalError:
        return _test(dataset, ~fit, np.full((1, 5), np.nan), partners)
    angles, table = np.array([refined.pose.angles]), dataset.correspondences
    rays, pixels = dataset.rays.copy(), np.hstack([table.primary, table.secondary])
    lenses = lenses_of_cameras(refined.primary, refined.secondary)
    if not undistort_rays(refined.at.q, lenses, pixels, rays):
        angles[:] = np.nan
    scale = pixel_scales((refined.primary, refined.secondary))
    return _test(dataset, ~fit, angles, partners, refined.pose.baseline, rays, scale)


def count_set(dataset: Pair, pose: Pose, rows: BoolArray | None = None) -> RunCounts:
    """Count all pairs and bars of a data set with one parameter set, without held-out frames.

    Args:
        dataset: with the cameras of the parameter set.
        rows: mask (n,) of the rows to count; all if None.
    """
    if rows is None:
        rows = np.ones(len(dataset.correspondences), dtype=np.bool_)
    partners = _partners(int(np.count_nonzero(rows)), np.random.default_rng(0))
    if dataset.recording.has_windows:
        return _count_behind_windows(dataset, pose, rows, partners)
    return _test(dataset, rows, np.array([pose.angles]), partners, pose.baseline)


def _count_behind_windows(
    dataset: Pair, pose: Pose, rows: BoolArray, partners: IntArray
) -> RunCounts:
    """`count_set` of cameras that look through windows."""
    counts, nans = np.zeros((1, 2, 2, BINS + 2), dtype=np.int32), np.zeros((1, 2), dtype=np.int64)
    table, rig = dataset.correspondences, Rig(dataset.primary, dataset.secondary, pose)
    pixels = np.hstack([table.primary, table.secondary])[rows]
    px = np.array([count_pairs_behind_windows(rig, pixels, partners, counts[0], nans[0])])
    bars = dataset.bars_among(rows)
    lengths = dataset.reconstructed_lengths_m(pose)[bars] / dataset.bar_distances_m[bars]
    return RunCounts(counts, nans, lengths[None], np.array([pose.angles]), px)


def stacked(first: RunCounts, second: RunCounts) -> RunCounts:
    """One run with the methods of both, concatenated along the first axis."""
    pairs = ((getattr(first, one.name), getattr(second, one.name)) for one in fields(RunCounts))
    return RunCounts(*(np.concatenate(pair) for pair in pairs))


def _test(
    dataset: Pair,
    rows: BoolArray,
    angles: FloatArray,
    partners: IntArray,
    baseline_m: float | None = None,
    rays: FloatArray | None = None,
    pixel_scale: FloatArray | None = None,
) -> RunCounts:
    """Count all pairs of the rows in `rows` (n,) with the angles (methods, 5) of each method.

    Args:
        baseline_m, rays, pixel_scale: of a set of its own; None: those of the data set.
    """
    rays = dataset.rays if rays is None else rays
    scale = dataset.pixel_scale if pixel_scale is None else pixel_scale
    baseline_m = dataset.baseline_m if baseline_m is None else baseline_m
    counts = np.zeros((len(angles), 2, 2, BINS + 2), dtype=np.int32)
    nans = np.zeros((len(angles), 2), dtype=np.int64)
    correct_px = np.empty(len(angles))
    bars, tested = dataset.bars_among(rows), np.ascontiguousarray(rays[:, rows])
    lengths = np.empty((len(angles), np.count_nonzero(bars)))
    one, other = (rays[:, ends] for ends in dataset.correspondences.bars[bars].T)
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    for k, of_method in enumerate(angles):
        fill_pose(of_method, baseline_m, R, T)
        fill_essential(R, T, E)
        correct_px[k] = count_pairs(R, T, E, tested, scale, partners, counts[k], nans[k])
        apart = triangulate_rays(R, T, one) - triangulate_rays(R, T, other)
        lengths[k] = np.linalg.norm(apart, axis=1) / dataset.bar_distances_m[bars]
    return RunCounts(counts, nans, lengths, angles, correct_px)


def _partners(points: int, rng: np.random.Generator) -> IntArray:
    """(points, p): the secondary points paired with each primary point, the correct one first."""
    steps = np.arange(1, points)
    if len(steps) > MAXIMUM_PARTNERS:
        steps = rng.choice(steps, MAXIMUM_PARTNERS, replace=False)
    primary = np.arange(points)[:, None]
    return np.asarray((primary + np.concatenate([[0], steps])) % points, dtype=np.int64)


def evaluate(
    datasets: Sequence[Pair],
    settings: EvaluationSettings,
    executor: Executor,
    progress: Progress | None = None,
) -> list[list[RunCounts]]:
    """All runs of all data sets, by data set, on any `concurrent.futures` executor.

    Args:
        progress: called with the runs done and the runs in all; what it raises ends the work.

    Returns:
        The runs by data set, in order.
    """
    for dataset in datasets:
        check_split(dataset, settings.calibration_frames)
    tasks = tasks_of_runs(datasets, settings)
    total = settings.runs * len(datasets)
    by_dataset: list[list[RunCounts]] = [[] for _ in datasets]
    with closing(run_tasks(tasks, executor, total, progress)) as finished:
        for task, of_chunk in finished:
            _, _, number, *_ = task.arguments
            by_dataset[number] += of_chunk
    return by_dataset


def tasks_of_runs(
    datasets: Sequence[Pair], settings: EvaluationSettings, frames_at_once: int = FRAMES_AT_ONCE
) -> Iterator[Task[list[RunCounts]]]:
    """Their keys are digests of everything that the runs depend on, and the runs' numbers.

    The data sets take turns, so that the first runs are of all of them, and a task has few runs of
    a long recording, for progress and so that others get a turn.
    """
    protocol = {name: value for name, value in settings.to_json().items() if name != "runs"}

    def tasks(number: int, dataset: Pair) -> Iterator[Task[list[RunCounts]]]:
        sigmas = [dataset.baseline_sigma_m, dataset.target_distance_sigma_m]
        content = json.dumps([dataset.sha256, sigmas, protocol, number], sort_keys=True)
        digest = hashlib.sha256(content.encode()).hexdigest()[:32]
        whole = WholeFit(dataset, settings.refined)
        few = max(1, frames_at_once // len(dataset.correspondences.frames))
        size = min(MOST_RUNS_AT_ONCE, few)
        for first in range(0, settings.runs, size):
            runs = range(first, min(first + size, settings.runs))
            key = f"{digest} {runs.start}-{runs.stop}"
            yield Task(evaluate_runs, (dataset, settings, number, runs, whole), len(runs), key)

    in_turn = zip_longest(*(tasks(number, dataset) for number, dataset in enumerate(datasets)))
    return (task for task in chain.from_iterable(in_turn) if task is not None)


def evaluate_runs(
    dataset: Pair,
    settings: EvaluationSettings,
    number: int,
    runs: Sequence[int],
    whole: WholeFit | None = None,
) -> list[RunCounts]:
    """Several runs of one data set; the unit of work of an executor."""
    whole = whole or WholeFit(dataset, settings.refined)
    return [evaluate_run(dataset, settings, number, run, whole) for run in runs]
