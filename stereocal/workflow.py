"""Run all methods on a data set: screening, the paper's three (section 3), the refined one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from stereocal.calibration import checks
from stereocal.calibration.essential import EssentialResult, calibrate_essential
from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.calibration.montecarlo import Problem, minimise
from stereocal.calibration.problems import reconstruction_problem, reprojection_problem
from stereocal.calibration.readings import check_reading, fit_at
from stereocal.calibration.results import POOR_LENGTH, MethodResult, errors_of
from stereocal.errors import StereocalError
from stereocal.refined.blame import doubts_about, why_nothing_fits
from stereocal.refined.refine import refine
from stereocal.refined.results import Calibration
from stereocal.refined.screening import Screening, screen, screened
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.compiled import IntArray
from stereocal.rig.dataset import Dataset


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
