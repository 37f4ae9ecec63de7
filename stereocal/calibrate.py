"""Run the methods on a data set: essential, 2D Monte Carlo, 3D Monte Carlo (paper, 3), refined."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from stereocal import checks, costs
from stereocal.compiled import BoolArray, FloatArray, IntArray
from stereocal.dataset import Dataset
from stereocal.errors import StereocalError
from stereocal.essential import Solver, calibrate_essential
from stereocal.geometry import Pose, reprojection_errors_of_rays
from stereocal.montecarlo import Problem, SearchSettings, Trace, minimise
from stereocal.parameters import RigParameters, inputs_of
from stereocal.refine import RefinedResult, refine
from stereocal.refined.unknowns import RefineSettings

Method = Literal["essential", "2d", "3d", "refined"]
METHODS: tuple[Method, ...] = ("essential", "2d", "3d")
"""The paper's."""
ALL_METHODS: tuple[Method, ...] = (*METHODS, "refined")
METHOD_NAMES: Mapping[Method, str] = {
    "essential": "Essential matrix",
    "2d": "2D set",
    "3d": "3D set",
    "refined": "Refined set",
}
COST_UNITS: Mapping[Method, str] = {"essential": "", "2d": "px", "3d": "m", "refined": ""}


@dataclass(frozen=True)
class CalibrationSettings:
    """Everything that can be tuned; the defaults are the paper's.

    Raises:
        StereocalError: a value outside its range.
    """

    search: SearchSettings = field(default_factory=SearchSettings)
    essential: Solver = "constrained"
    calibration_frames: int | None = None
    """Calibrate with so many frames, drawn at random; with all when None."""
    known_points: bool = False
    """The footnote's 3D cost: distance from known points instead of lengths of bars."""

    def __post_init__(self) -> None:
        if self.essential not in ("constrained", "linear"):
            raise StereocalError(
                f'The essential solver "{self.essential}" is not known: constrained or linear.'
            )
        if self.calibration_frames is not None and self.calibration_frames < 1:
            raise StereocalError("The number of calibration frames must be at least 1.")

    def to_json(self) -> dict[str, Any]:
        """All settings in one flat object."""
        return {
            **asdict(self.search),
            "essential": self.essential,
            "calibration_frames": self.calibration_frames,
            "known_points": self.known_points,
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> CalibrationSettings:
        """The settings that `to_json` describes; what is missing keeps its default.

        Raises:
            StereocalError: a name that is no setting, or a value of the wrong kind or range.
        """
        rest = dict(data)
        own = {
            name: rest.pop(name)
            for name in ("essential", "calibration_frames", "known_points")
            if name in rest
        }
        try:
            if not isinstance(own.get("known_points", False), bool):
                raise TypeError("known_points is neither true nor false")
            if not isinstance(own.get("calibration_frames"), int | None):
                raise TypeError("calibration_frames is not a whole number")
            return cls(search=SearchSettings(**rest), **own)
        except TypeError as error:
            raise StereocalError(f"The settings cannot be read: {error}.") from error


@dataclass(frozen=True, eq=False)
class MethodResult:
    """The pose that one method found, and how."""

    method: Method
    pose: Pose
    cost: float
    """Unit: `COST_UNITS[method]`."""
    evaluations: int
    stop_reason: str
    seconds: float
    trace: Trace | None = None


@dataclass(frozen=True, eq=False)
class Errors:
    """How a pose fits the data set, frame by frame."""

    reprojection_px: FloatArray
    """(n,), per pair the mean over both cameras; NaN where the point is behind a camera."""
    length: FloatArray
    """(m,), per bar |D - D^R| / D, a fraction; NaN likewise."""

    @property
    def mean_reprojection_px(self) -> float:
        """Mean over the pairs that have a value; NaN if none has."""
        return _mean(self.reprojection_px)

    @property
    def mean_length(self) -> float:
        """Mean relative length error over the bars that have a value; NaN if none has."""
        return _mean(self.length)

    @property
    def p95_length(self) -> float:
        """The relative length error that 95 % of the bars stay below; NaN if none has one."""
        known = self.length[np.isfinite(self.length)]
        return float(np.percentile(known, 95)) if len(known) else float("nan")


@dataclass(frozen=True, eq=False)
class Calibration:
    """The results of all methods, with the data and the settings that made them."""

    dataset: Dataset
    settings: CalibrationSettings
    frames: IntArray
    """The frames that were calibrated with; the others only test."""
    methods: Mapping[Method, MethodResult]
    warnings: tuple[str, ...]
    """What is odd about the data, a sentence each."""
    refined: RefinedResult | None = None
    """The refined set, where it was asked for and could be found."""

    @cached_property
    def held_out_frames(self) -> IntArray:
        """The frames that were not calibrated with."""
        return np.setdiff1d(self.dataset.correspondences.frames, self.frames)

    @cached_property
    def errors(self) -> Mapping[Method, Errors]:
        """Errors of each method on all frames, also those not calibrated with."""
        return {name: errors_of(self.dataset, found.pose) for name, found in self.methods.items()}

    @cached_property
    def refined_errors(self) -> Errors | None:
        """Errors of the refined set, seen through its own lenses, on all frames."""
        if self.refined is None:
            return None
        return errors_of(self.refined.apply(self.dataset), self.refined.pose)

    def parameters(
        self,
        method: Literal["2d", "3d"],
        validation: Mapping[str, Any] | None = None,
    ) -> RigParameters:
        """The parameter set to save: `2d` for matching, `3d` for reconstruction.

        Args:
            validation: figures of a validation of this data set, where there was one; its
                `threshold_px` becomes the recommended limit of a match.
        """
        found = self.methods[method]
        return RigParameters(
            method=method,
            primary=self.dataset.primary,
            secondary=self.dataset.secondary,
            pose=found.pose,
            cost=found.cost,
            settings=self.settings.to_json(),
            inputs=inputs_of(self.dataset, self.frames),
            matching_threshold_px=validation["threshold_px"] if validation else None,
            validation=validation,
        )


def calibrate(
    dataset: Dataset,
    settings: CalibrationSettings | None = None,
    trace: bool = False,
    progress: Callable[[str], None] | None = None,
    refined: RefineSettings | None = None,
) -> Calibration:
    """Run the paper's three methods and, where its settings are given, the refined one.

    The random numbers of the two searches are independent streams of `settings.search.seed`.

    Args:
        trace: record every move of the searches.
        progress: called with the name of each method as it begins.
        refined: settings of the refined method. If it fails, the others stand, and a warning says
            why.

    Raises:
        StereocalError: the data do not allow a calibration; says why and what to do.
    """
    settings = settings or CalibrationSettings()
    say = progress or (lambda _: None)
    seeds = np.random.SeedSequence(settings.search.seed).spawn(4)
    of_split, of_2d, of_3d, of_exchange = seeds
    frames = _draw_frames(dataset, settings.calibration_frames, of_split)
    chosen = _only(dataset, frames)
    checks.check_points(chosen)
    reconstruction = reconstruction_problem(chosen, settings.known_points)

    say("essential")
    start = calibrate_essential(
        chosen.rays, chosen.baseline_m, settings.essential, tie_breaker=reconstruction.cost
    )
    checks.check_in_front(chosen, start.pose)
    checks.check_scale(chosen, start.pose)
    results: dict[Method, MethodResult] = {
        "essential": MethodResult(
            "essential", start.pose, start.cost, start.evaluations, start.stop_reason, start.seconds
        )
    }
    for name, problem, seed in (
        ("2d", reprojection_problem(chosen), of_2d),
        ("3d", reconstruction, of_3d),
    ):
        method: Method = "2d" if name == "2d" else "3d"
        say(method)
        found = minimise(problem, start.pose, settings.search, seed, trace)
        results[method] = MethodResult(
            method, found.pose, found.cost, found.evaluations, found.stop_reason, found.seconds,
            found.trace,
        )  # fmt: skip
    as_given = (results["2d"].cost, results["3d"].cost)
    exchanged = _costs_with_cameras_exchanged(chosen, settings, of_exchange)
    warnings = checks.warnings_about(chosen) + checks.check_exchange(as_given, exchanged)
    fourth = None
    if refined is not None:
        say("refined")
        try:
            fourth = refine(chosen, refined, start.pose)
        except StereocalError as error:
            warnings.append(f"There is no refined set: {error}")
    return Calibration(dataset, settings, frames, results, tuple(warnings), fourth)


def reprojection_problem(dataset: Dataset, rows: BoolArray | None = None) -> Problem:
    """The 2D cost on all pairs of a data set, or on those of some rows (n,)."""
    rays = dataset.rays if rows is None else np.ascontiguousarray(dataset.rays[:, rows])
    return Problem(costs.REPROJECTION, rays, np.empty((0, 0)), dataset.pixel_scale)


def reconstruction_problem(
    dataset: Dataset, known_points: bool = False, rows: BoolArray | None = None
) -> Problem:
    """The 3D cost on all bars of a data set, or on its known points; or on those of some rows (n,).

    Raises:
        StereocalError: no frame has both targets, or no row has a known point.
    """
    table = dataset.correspondences
    wanted = np.ones(len(table), dtype=np.bool_) if rows is None else rows
    if known_points:
        known = wanted & np.isfinite(table.known_points_m).all(axis=1)
        if not known.any():
            raise StereocalError(
                "No row has a known point: the columns x_m, y_m, z_m are missing or empty."
            )
        return Problem(
            costs.POINTS,
            np.ascontiguousarray(dataset.rays[:, known]),
            np.ascontiguousarray(table.known_points_m[known].T),
            dataset.pixel_scale,
        )
    bars = dataset.bars_among(wanted)
    if not bars.any():
        raise StereocalError(
            "No frame has both targets A and B, so there is no length to measure: the 3D method "
            "needs frames in which both cameras see both ends of the bar."
        )
    return Problem(
        costs.DISTANCE,
        np.ascontiguousarray(dataset.rays[:, table.bars[bars].T.ravel()]),
        dataset.bar_distances_m[None, bars],
        dataset.pixel_scale,
    )


def errors_of(dataset: Dataset, pose: Pose) -> Errors:
    """Reprojection and length errors of a pose on a data set."""
    both = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale)
    lengths = dataset.reconstructed_lengths_m(pose)
    measured = dataset.bar_distances_m
    return Errors(both.mean(axis=1), np.abs(lengths - measured) / measured)


def _costs_with_cameras_exchanged(
    dataset: Dataset, settings: CalibrationSettings, seed: np.random.SeedSequence
) -> tuple[float, float] | None:
    """2D and 3D cost with the two camera files the other way round.

    None where that cannot be, and for so few points that any cameras fit them.
    """
    if len(dataset.correspondences.bars) < checks.BARS_TO_TELL:
        return None
    try:
        other = dataset.with_cameras_exchanged()
        start = calibrate_essential(other.rays, other.baseline_m, settings.essential)
        matching, measuring = (
            minimise(problem, start.pose, settings.search, seed).cost
            for problem in (
                reprojection_problem(other),
                reconstruction_problem(other, settings.known_points),
            )
        )
    except StereocalError:
        return None
    return matching, measuring


def _draw_frames(dataset: Dataset, count: int | None, seed: np.random.SeedSequence) -> IntArray:
    frames = dataset.correspondences.frames
    if count is None or count == len(frames):
        return frames
    if count > len(frames):
        raise StereocalError(
            f"{count} calibration frames are wanted, but the data set has {len(frames)}."
        )
    rng = np.random.Generator(np.random.PCG64(seed))
    return np.sort(rng.choice(frames, count, replace=False))


def _only(dataset: Dataset, frames: IntArray) -> Dataset:
    if len(frames) == len(dataset.correspondences.frames):
        return dataset
    return dataset.of_frames(frames)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
