"""What is computed of two cameras: `PairRun`, whose steps are made when asked for.

Screening, the paper's three methods (Section 3) and the refined one, a validation and the forecast.
What it comes to is a `PairAnswer`.
"""

from collections.abc import Callable
from concurrent.futures import Executor
from dataclasses import dataclass, field
from typing import get_args

import numpy as np

from stereocal.calibration import checks
from stereocal.calibration.board_numbering import note_on_ways_round
from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.methods import METHODS, POOR_LENGTH, CalibrationSettings, errors_of
from stereocal.calibration.montecarlo import (
    MethodResult,
    Problem,
    reconstruction_problem,
    two_searches,
)
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.fit.errors.misfit import Misfit, misfit_of
from stereocal.fit.errors.stated_inputs import Input
from stereocal.fit.errors.uncertainty import AccuracyMap, Plane, accuracy_map
from stereocal.fit.least_squares.unknowns import RefineSettings, check_stated
from stereocal.fit.readings.changing_focal import changing_focal_of_pair
from stereocal.fit.readings.likely_cause import (
    claimed_offset,
    explain_failure,
    frames_to_judge,
    offer_time_offset,
    warnings_about_fit,
)
from stereocal.fit.readings.windows import into_water
from stereocal.fit.readings.wrong_inputs import check_inputs, instead_of_movement
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.results import Calibration
from stereocal.fit.screening.misplaced_target import misplaced_target
from stereocal.fit.screening.movement import MovedError
from stereocal.fit.screening.screen import Screening, screened
from stereocal.fit.screening.stretched_board import stretched_board
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.fit.start.free_baseline import note_on_free_baseline
from stereocal.formats.evaluation_files import Evaluation
from stereocal.rig.pair import Pair
from stereocal.rig.recording import REFINED_ONLY
from stereocal.system.array_types import IntArray
from stereocal.system.latest import step
from stereocal.system.tasks import Progress
from stereocal.verdict.forecast import Forecast, advice_on_improvements, forecast_files
from stereocal.verdict.in_words import left_out_line

STEPS = ("screening", "essential", "2d", "3d", "refined", "forecast")
"""What takes time, in order."""
MAP_SIZE = 45
"""Points of an accuracy map along each side; both maps take 0.1 s."""
DEFAULT_REFINED = RefineSettings()


def _untold(_step: str) -> None:
    """Nobody waits for it."""


@dataclass(eq=False)
class PairRun:
    """All that is computed from a recording of two cameras. Each step is made when it is first
    asked for, and kept; any thread may ask."""

    dataset: Pair
    settings: CalibrationSettings = field(default_factory=CalibrationSettings)
    refined: RefineSettings | None = DEFAULT_REFINED
    """Settings of the refined method, except whether a time offset is solved for, which `settings`
    and the screening say; None: without this method."""
    finished: Calibration | None = None
    """Taken instead of calibrating."""
    trace: bool = False
    """Whether every move of the searches is recorded."""
    progress: Callable[[str], None] = _untold
    """Called with the name of each of `STEPS` when it begins."""

    def __post_init__(self) -> None:
        if self.dataset.recording.has_windows:
            raise StereocalError(
                f"{self.dataset.name}: {REFINED_ONLY}, which all cameras together give: "
                "`stereocal calibrate` without a pair, or `stereocal.calibrate(recording)`."
            )

    @classmethod
    def of(cls, finished: Calibration) -> "PairRun":
        """The run of a finished calibration."""
        refined = None if finished.refined is None else finished.refined.settings
        return cls(finished.dataset, finished.settings, refined, finished)

    def validate(
        self, settings: EvaluationSettings, executor: Executor, progress: Progress | None = None
    ) -> Evaluation:
        """A validation of the frames that are not left out."""
        kept = self.screening.dataset
        runs = evaluate([kept], settings, executor, progress)
        return Evaluation(runs, settings, [kept.name], [self.calibration.dataset.sha256])

    @step
    def screening(self) -> Screening:
        """The frames that contradict the others, and the recording without them."""
        if self.finished is not None:
            return self.finished.screening
        self.progress("screening")
        dataset = with_baseline_found(self.dataset)
        try:
            return screened(dataset, self.settings)
        except MovedError as error:
            raise MovedError(instead_of_movement(dataset.recording) or str(error)) from error

    @step
    def calibration(self) -> Calibration:
        """The sets of all methods. If the refined method fails, a warning has the reason."""
        if self.finished is not None:
            return self.finished
        try:
            return self._calibrated()
        except StereocalError as error:
            if self._into_water:
                raise StereocalError(self._into_water) from error
            raise

    @step
    def _into_water(self) -> str:
        """As of `into_water`, of all frames."""
        return into_water(self.dataset.recording)

    def _calibrated(self) -> Calibration:
        """The sets of all methods, computed."""
        settings = self.settings
        if self.refined is not None:
            check_stated(self.refined, self.dataset.recording)
        screening = self.screening
        dataset, kept = screening.full_dataset, screening.dataset
        frames = _draw_frames(screening, settings.calibration_frames, settings.search.seed)
        all_kept = len(frames) == len(kept.correspondences.frames)
        chosen = kept if all_kept else kept.of_frames(frames)
        try:
            checks.check_enough_points(chosen)
        except StereocalError as error:
            raise StereocalError(f"{error} {left_out_line(screening)}".rstrip()) from error
        reconstruction = reconstruction_problem(chosen, settings.known_points)
        warnings = [
            *filter(None, [note_on_free_baseline(chosen), note_on_ways_round(chosen.recording)]),
            *checks.warnings_about(chosen),
            *checks.warnings_about_copies(dataset),
        ]
        self.progress("essential")
        start = _essential(chosen, settings, reconstruction, screening)
        offset = claimed_offset(screening)
        offer = offer_time_offset(offset)
        warnings += check_inputs(
            frames_to_judge(chosen, screening).recording, out_of_step=bool(offer)
        )
        searched = two_searches(
            chosen, start.pose, settings.search, settings.known_points, self.trace, self.progress
        )
        results = dict(zip(METHODS, [start, *searched], strict=True))
        poor = errors_of(chosen, results["3d"].pose).p95_length > POOR_LENGTH
        if poor and self._into_water:
            raise StereocalError(self._into_water)
        warnings += warnings_about_fit(chosen, screening, poor, offer)
        refined, focal = None, ""
        if self.refined is not None:
            self.progress("refined")
            try:
                # Without an initial pose, as for a stored calibration: its files are the same.
                refined = refine(chosen, screening.solved_for(self.refined, settings))
                focal = "" if offer else changing_focal_of_pair(refined)
                warnings += filter(None, [misplaced_target(refined), focal])
            except StereocalError as error:
                warnings.append(f"There is no refined set: {error}")
        if refined is not None and (stretched := stretched_board(refined)):
            warnings.append(stretched)
        of_all = dataset, settings, screening, frames, results, tuple(warnings), refined
        return Calibration(*of_all, out_of_step=bool(offer), focal_changes=bool(focal))

    @step
    def forecast_or_reason(self) -> Forecast | str:
        """The forecast of the files, or why there cannot be one."""
        calibration = self.calibration
        self.progress("forecast")
        try:
            return forecast_files(calibration)
        except StereocalError as error:
            return str(error)

    @property
    def forecast(self) -> Forecast | None:
        """The forecast of the files; None if there cannot be one."""
        outcome = self.forecast_or_reason
        return None if isinstance(outcome, str) else outcome

    @property
    def no_forecast(self) -> str:
        """Why there is no forecast; empty if there is one."""
        outcome = self.forecast_or_reason
        return outcome if isinstance(outcome, str) else ""

    @step
    def advice(self) -> str:
        """What would lower the errors of the refined set: 9 s for 20,000 frames; empty without a
        forecast."""
        return "" if self.forecast is None else advice_on_improvements(self.forecast.model)

    @step
    def maps(self) -> list[AccuracyMap]:
        """Predicted errors of the refined set by position, from above and from the side."""
        return [accuracy_map(self.refined_set, MAP_SIZE, plane) for plane in get_args(Plane)]

    @step
    def misfit(self) -> Misfit:
        """Residuals of the refined set over the images."""
        return misfit_of(self.refined_set)

    @property
    def inputs(self) -> list[Input]:
        """Which input values the images contradict; empty without a refined set."""
        return self.calibration.inputs

    @property
    def refined_set(self) -> RefinedResult:
        if self.calibration.refined is None:
            raise StereocalError("There is no refined set of these data.")
        return self.calibration.refined


def _essential(
    dataset: Pair, settings: CalibrationSettings, reconstruction: Problem, screening: Screening
) -> MethodResult:
    """The essential method, with a check of the scale against the stated lengths.

    If the 8-point estimate fails, as with all bars in one plane, the constrained solver is started
    again from the pose of the robust fit.
    """
    fit = screening.fit
    starts = [None, fit.pose] if fit is not None and settings.essential == "constrained" else [None]
    failure = ""
    for pose in starts:
        try:
            start = calibrate_essential(
                dataset.rays, dataset.baseline_m, settings.essential, reconstruction.cost, pose
            )
            checks.check_in_front(dataset, start.pose)
            if checks.scale_is_plausible(dataset, start.pose):
                return start
        except StereocalError as error:
            failure = failure or f"{error} "
    raise StereocalError(explain_failure(dataset, screening, failure))


def _draw_frames(screening: Screening, count: int | None, seed: int) -> IntArray:
    """`count` random frames of those that passed the screening; all of them if fewer are left."""
    total = len(screening.full_dataset.correspondences.frames)
    frames = screening.dataset.correspondences.frames
    if count is not None and count > total:
        raise StereocalError(
            f"{count} calibration frames were requested, but the data set has {total}."
        )
    if count is None or count >= len(frames):
        return frames
    rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed).spawn(1)[0]))
    return np.sort(rng.choice(frames, count, replace=False))


def usual_frames(frames: int) -> int:
    """The default number of frames to calibrate with: 4 of 5, as the paper's 20 of 25."""
    return max(4 * frames // 5, 1)
