"""Run the methods on a data set: essential, 2D Monte Carlo, 3D Monte Carlo (paper, 3), refined."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Any, Literal

import numpy as np

from stereocal import checks, costs
from stereocal.blame import doubts_about, why_nothing_fits
from stereocal.compiled import BoolArray, FloatArray, IntArray
from stereocal.dataset import Dataset
from stereocal.errors import StereocalError
from stereocal.essential import EssentialResult, Solver, calibrate_essential
from stereocal.geometry import Pose, reprojection_errors_of_rays
from stereocal.montecarlo import Problem, SearchSettings, Trace, minimise
from stereocal.parameters import RigParameters, inputs_of
from stereocal.readings import check_reading, fit_at
from stereocal.refine import RefinedResult, refine
from stereocal.refined.screening import Screening, screen, unscreened
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
POOR_LENGTH = 0.05
"""A set that measures 5 % of the bars worse than this is not one to measure with."""
MOST_LEFT_OUT = 0.2
"""Where more frames than this contradict the others, the others may be the wrong ones."""
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
    all_frames: bool = False
    """Trust every frame, as the paper does: leave none out that contradicts the others."""
    frames_put_back: tuple[int, ...] = ()
    """Frames to keep though they contradict the others."""

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
            "all_frames": self.all_frames,
            "frames_put_back": list(self.frames_put_back),
        }

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> CalibrationSettings:
        """The settings that `to_json` describes; what is missing keeps its default.

        Raises:
            StereocalError: a name that is no setting, or a value of the wrong kind or range.
        """
        rest = dict(data)
        own: dict[str, Any] = {
            name: rest.pop(name)
            for name in ("essential", "calibration_frames", "known_points", "all_frames")
            if name in rest
        }
        try:
            for name in ("known_points", "all_frames"):
                if not isinstance(own.get(name, False), bool):
                    raise TypeError(f"{name} is neither true nor false")
            back = rest.pop("frames_put_back", [])
            if not all(isinstance(frame, int) for frame in back):
                raise TypeError("frames_put_back is no list of frame numbers")
            own["frames_put_back"] = tuple(sorted(back))
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
    """How a pose fits the data set, frame by frame; the means are of the frames not left out."""

    reprojection_px: FloatArray
    """(n,), per pair the mean over both cameras; NaN where the point is behind a camera."""
    length: FloatArray
    """(m,), per bar |D - D^R| / D, a fraction; NaN likewise."""
    kept_pairs: BoolArray
    """(n,): false for the pairs of frames that were left out."""
    kept_bars: BoolArray
    """(m,): the same for bars."""

    @property
    def mean_reprojection_px(self) -> float:
        """Mean over the pairs that have a value; NaN if none has."""
        return _mean(self.reprojection_px[self.kept_pairs])

    @property
    def mean_length(self) -> float:
        """Mean relative length error over the bars that have a value; NaN if none has."""
        return _mean(self.length[self.kept_bars])

    @property
    def p95_length(self) -> float:
        """The relative length error that 95 % of the bars stay below; NaN if none has one."""
        known = self.length[self.kept_bars & np.isfinite(self.length)]
        return float(np.percentile(known, 95)) if len(known) else float("nan")


@dataclass(frozen=True, eq=False)
class Calibration:
    """The results of all methods, with the data and the settings that made them."""

    dataset: Dataset
    settings: CalibrationSettings
    screening: Screening
    """Which frames were left out, because they contradict the others."""
    frames: IntArray
    """The frames that were calibrated with; the others that are left only test."""
    methods: Mapping[Method, MethodResult]
    warnings: tuple[str, ...]
    """What is odd about the data, a sentence each."""
    refined: RefinedResult | None = None
    """The refined set, where it was asked for and could be found."""

    @cached_property
    def held_out_frames(self) -> IntArray:
        """The frames that were neither calibrated with nor left out."""
        return np.setdiff1d(self.screening.dataset.correspondences.frames, self.frames)

    @cached_property
    def errors(self) -> Mapping[Method, Errors]:
        """Errors of each method on all frames, also those not calibrated with."""
        left_out = self.screening.left_out
        return {
            name: errors_of(self.dataset, found.pose, left_out)
            for name, found in self.methods.items()
        }

    @cached_property
    def refined_errors(self) -> Errors | None:
        """Errors of the refined set, seen through its own lenses, on all frames."""
        if self.refined is None:
            return None
        left_out = self.screening.left_out
        return errors_of(self.refined.apply(self.dataset), self.refined.pose, left_out)

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
            frames_left_out=self.screening.left_out,
        )


def calibrate(
    dataset: Dataset,
    settings: CalibrationSettings | None = None,
    trace: bool = False,
    progress: Callable[[str], None] | None = None,
    refined: RefineSettings | None = None,
) -> Calibration:
    """Run the paper's three methods and, where its settings are given, the refined one.

    Frames that contradict the others are left out first, unless the settings trust every frame.

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
    of_split, of_2d, of_3d = np.random.SeedSequence(settings.search.seed).spawn(3)
    say("screening")
    screening = screened(dataset, settings)
    kept = screening.dataset
    frames = _draw_frames(screening, settings.calibration_frames, of_split)
    chosen = _only(kept, frames)
    checks.check_points(chosen)
    reconstruction = reconstruction_problem(chosen, settings.known_points)
    warnings = checks.warnings_about(chosen)

    say("essential")
    start = _essential(chosen, settings, reconstruction, screening)
    warnings += check_reading(chosen, fit_at(chosen, start.pose))
    results: dict[Method, MethodResult] = {
        "essential": MethodResult(
            "essential", start.pose, start.cost, start.evaluations, start.stop_reason, start.seconds
        )
    }
    searches: tuple[tuple[Method, Problem, np.random.SeedSequence], ...] = (
        ("2d", reprojection_problem(chosen), of_2d),
        ("3d", reconstruction, of_3d),
    )
    for method, problem, seed in searches:
        say(method)
        found = minimise(problem, start.pose, settings.search, seed, trace)
        results[method] = MethodResult(
            method, found.pose, found.cost, found.evaluations, found.stop_reason, found.seconds,
            found.trace,
        )  # fmt: skip
    poor = errors_of(chosen, results["3d"].pose).p95_length > POOR_LENGTH
    warnings += doubts_about(chosen, screening, poor)
    fourth = None
    if refined is not None:
        say("refined")
        try:
            fourth = refine(chosen, refined, start.pose)
        except StereocalError as error:
            warnings.append(f"There is no refined set: {error}")
    return Calibration(dataset, settings, screening, frames, results, tuple(warnings), fourth)


def screened(dataset: Dataset, settings: CalibrationSettings) -> Screening:
    """Which frames of a data set to leave out, as the settings say."""
    return unscreened(dataset) if settings.all_frames else screen(dataset, settings.frames_put_back)


def _essential(
    dataset: Dataset,
    settings: CalibrationSettings,
    reconstruction: Problem,
    screening: Screening,
) -> EssentialResult:
    """The essential method, whose pose agrees with the stated lengths.

    Where the 8-point estimate leads nowhere, as with bars in one plane, the constrained solver
    begins at the pose of the robust fit.

    Raises:
        StereocalError: it does not agree; says what is wrong, as far as the data tell.
    """
    fit = screening.fit
    begin = [None, fit.pose] if fit is not None and settings.essential == "constrained" else [None]
    failure = ""
    for pose in begin:
        try:
            start = calibrate_essential(
                dataset.rays, dataset.baseline_m, settings.essential, reconstruction.cost, pose
            )
            checks.check_in_front(dataset, start.pose)
            if checks.scale_is_plausible(dataset, start.pose):
                return start
        except StereocalError as error:
            failure = failure or f"{error} "
    raise StereocalError(failure + why_nothing_fits(dataset, fit or screen(dataset).fit))


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


def errors_of(dataset: Dataset, pose: Pose, left_out: Collection[int] = ()) -> Errors:
    """Reprojection and length errors of a pose on a data set.

    Args:
        left_out: numbers of frames that the means are without.
    """
    rows = dataset.correspondences
    kept = ~np.isin(rows.frame, list(left_out))
    both = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale)
    lengths = dataset.reconstructed_lengths_m(pose)
    measured = dataset.bar_distances_m
    return Errors(
        both.mean(axis=1), np.abs(lengths - measured) / measured, kept, dataset.bars_among(kept)
    )


def _draw_frames(screening: Screening, count: int | None, seed: np.random.SeedSequence) -> IntArray:
    """So many of the frames that are left, or all of them where that is fewer than were given."""
    given = len(screening.given.correspondences.frames)
    frames = screening.dataset.correspondences.frames
    if count is not None and count > given:
        raise StereocalError(
            f"{count} calibration frames are wanted, but the data set has {given}."
        )
    if count is None or count >= len(frames):
        return frames
    rng = np.random.Generator(np.random.PCG64(seed))
    return np.sort(rng.choice(frames, count, replace=False))


def _only(dataset: Dataset, frames: IntArray) -> Dataset:
    if len(frames) == len(dataset.correspondences.frames):
        return dataset
    return dataset.of_frames(frames)


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
