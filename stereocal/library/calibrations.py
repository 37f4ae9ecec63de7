"""Calibrate two cameras or more: results that say what to use, and how good it is."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np
import pandas as pd

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.errors import StereocalError, naming
from stereocal.evaluation.evaluate import EvaluationSettings, Splits
from stereocal.evaluation.evaluate import evaluate as evaluate_runs
from stereocal.evaluation.summary import MethodSummary, summarise_all
from stereocal.fit.in_words import loops_sentence, rig_notes, rig_sentence, windows_sentence
from stereocal.fit.least_squares.unknowns import RefineSettings, check_stated
from stereocal.fit.results import Calibration
from stereocal.fit.rig_file import RigFile
from stereocal.fit.timing.to_calibrate import in_step, pair_to_calibrate
from stereocal.formats.dataset_files import read_recording
from stereocal.formats.evaluation_files import Evaluation, unique_names
from stereocal.formats.exchange.exchange import export
from stereocal.library.drawing import draw, of_figures
from stereocal.rig.camera import LensModel
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import RigParameters
from stereocal.rig.recording import REFINED_ONLY, Recording
from stereocal.system.answers import TableAnswer, answering
from stereocal.system.arguments import checked
from stereocal.system.atomic_files import write_all
from stereocal.system.executors import engine
from stereocal.system.numbers import count
from stereocal.verdict.in_words import refuse_unknown_frames
from stereocal.verdict.recommendation import Recommendation
from stereocal.verdict.validation_in_words import validation_answer
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import DEFAULT_REFINED, PairRun, usual_frames
from stereocal.workflow.run import Run

if TYPE_CHECKING:
    import plotly.graph_objects as go

Look = Literal["rig", "errors", "validation", "disagreement", "accuracy", "residuals"]


@checked
def read(
    path: str | Path, pair: str | None = None, lens_model: LensModel | None = None
) -> Pair | Recording:
    """Read a data set from a folder or a zip: two cameras as a pair; more, or behind a window, as a
    recording.

    Args:
        pair: such as `left-right`: two of more cameras.
        lens_model: meaning of four distortion coefficients if a camera file does not state it.

    Raises:
        StereocalError: what is wrong, in which file and row.
    """
    recording = read_recording(path, lens_model)
    with naming(str(path)):
        if pair is None and (len(recording.cameras) > 2 or recording.has_windows):
            return in_step(recording)
        return pair_to_calibrate(recording, pair)


def recording_of(given: Pair | Recording) -> Recording:
    """The recording itself, or that of a pair's two cameras."""
    return given.recording if isinstance(given, Pair) else given


def pair_of(given: Pair | Recording) -> Pair:
    """Two cameras; a baseline that was not measured is found.

    Raises:
        StereocalError: the recording has more than two cameras.
    """
    recording = recording_of(given)
    if len(recording.cameras) > 2:
        raise StereocalError(
            f"{recording.name}: it has {len(recording.cameras)} cameras. Calibrate them as one "
            "with `stereocal.calibrate_rig(recording)`, or choose two with "
            "`recording.pair(first, second)`."
        )
    return pair_to_calibrate(recording)


class Sets(dict[Method, RigParameters]):
    """Parameter sets by method."""

    def __missing__(self, method: object) -> RigParameters:
        raise StereocalError(f"There is no parameter set {method!r}: there are {', '.join(self)}.")


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationRun(TableAnswer, Calibration):
    """The sets of all methods, which of them to use for what, and how good they are."""

    @cached_property
    def _found(self) -> PairAnswer:
        """What it comes to, made when it is asked for."""
        return PairAnswer(PairRun.of(self))

    @property
    def run(self) -> PairRun:
        """All that is computed from the recording, made when it is asked for."""
        return self._found.run

    @property
    def recommendation(self) -> Recommendation:
        """Which set to use for what, and how good it is."""
        return self._found.recommendation

    @property
    def sets(self) -> Sets:
        """The parameter sets: 2d, 3d and, if available, refined."""
        return Sets(self._found.sets)

    @property
    def answer(self) -> list[str]:
        return [*self.recommendation.answer, *(f"Note: {note}" for note in self.warnings)]

    @checked
    def evaluate(
        self,
        runs: int = 100,
        calibration_frames: int | None = None,
        splits: Splits = "runs",
        executor: Executor | None = None,
    ) -> Validation:
        """Validate on random splits of the frames that are not left out; the recommendation and the
        sets have its figures from then on.

        Args:
            calibration_frames: of each run; None: 4 of 5 frames.
            executor: None: threads.
        """
        frames = len(self.screening.dataset.correspondences.frames)
        settings = EvaluationSettings(
            replace(self.settings, calibration_frames=None),
            runs,
            calibration_frames or usual_frames(frames),
            splits,
            self.run.refined,
        )
        with engine() if executor is None else nullcontext(executor) as workers:
            validation = self.run.validate(settings, workers)
        vars(self)["_found"] = PairAnswer(self.run, validation)
        return Validation(validation)

    @checked
    def save(self, folder: str | Path) -> None:
        """Write the parameter files of all sets, all or none."""
        files = self._found.parameter_files
        write_all({Path(folder) / name: content for name, content in files.items()})

    @checked
    def export(self, to: str, path: str | Path, method: Method | None = None) -> None:
        """Write a set for another program, as `stereocal.export`.

        Args:
            method: None: the set that is recommended to measure with.
        """
        export(self.sets[method or self.recommendation.measure.method], to, path)

    def to_dataframe(self) -> pd.DataFrame:
        """Errors on all frames not left out, and poses; a row a method, lengths as fractions."""
        poses = {name: result.pose for name, result in self.methods.items()}
        if self.refined is not None:
            poses["refined"] = self.refined.pose
        rows = {
            name: {
                "mean_reprojection_px": errors.mean_reprojection_px,
                "mean_length_error": errors.mean_length,
                "p95_length_error": errors.p95_length,
                "baseline_m": poses[name].baseline,
                **{
                    f"{angle}_deg": float(np.degrees(value))
                    for angle, value in poses[name].angles._asdict().items()
                },
            }
            for name, errors in self.errors.items()
        }
        return pd.DataFrame(rows).T.rename_axis("method")

    @checked
    def plot(self, look: Look | None = None, method: Method | None = None) -> go.Figure:
        """A figure of the page.

        Args:
            look: "rig", "errors" by frame, "validation" (the paper's 3x3), "disagreement" of the
                inputs, "accuracy" by place, "residuals" over the images; None: the validation, if
                there is one, else the rig.
            method: of the rig; None: the one to measure with.

        Raises:
            StereocalError: there is no such look or set, or no validation yet.
        """
        evaluation = self._found.evaluation
        look = look or ("rig" if evaluation is None else "validation")
        if look == "rig":
            return draw("rig.plot_rig", self, method or self.recommendation.measure.method)
        if look == "errors":
            return draw("frame_errors.plot_frame_errors", self)
        if look == "validation":
            if evaluation is None:
                raise StereocalError("There is no validation yet: call `evaluate()` first.")
            return Validation(evaluation).plot()
        if look == "disagreement":
            return draw("one_set.plot_disagreement", self.inputs)
        if look == "accuracy":
            return draw("accuracy.plot_accuracy", self.run.maps, self.run.refined_set)
        return draw("lens.plot_misfit", self.run.misfit)


@overload
def calibrate(
    dataset: Pair,
    settings: CalibrationSettings | None = None,
    trace: bool = False,
    progress: Callable[[str], None] | None = None,
    refined: RefineSettings | None = DEFAULT_REFINED,
) -> CalibrationRun: ...


@overload
def calibrate(
    dataset: Recording,
    settings: CalibrationSettings | None = None,
    trace: bool = False,
    progress: Callable[[str], None] | None = None,
    refined: RefineSettings | None = DEFAULT_REFINED,
) -> CalibrationRun | CalibratedRig: ...


@checked
def calibrate(
    dataset: Pair | Recording,
    settings: CalibrationSettings | None = None,
    trace: bool = False,
    progress: Callable[[str], None] | None = None,
    refined: RefineSettings | None = DEFAULT_REFINED,
) -> CalibrationRun | CalibratedRig:
    """Calibrate two cameras with the paper's three methods and the refined method; three and more,
    and two behind a window, as `calibrate_rig` does, with the refined method.

    Frames that contradict the others are left out first, unless `settings.all_frames` is set. The
    2D and the 3D search use independent random streams derived from `settings.search.seed`.

    Args:
        settings: of two cameras.
        trace: record every move of the searches.
        progress: called with the name of each method when it starts.
        refined: settings of the refined method, except whether a time offset is solved for, which
            `settings` and the screening say; None: without this method. If it fails, the result has
            the other methods and a warning with the reason.

    Raises:
        StereocalError: the data contradict each other or do not suffice; it says which, and what to
            do.
    """
    recording = recording_of(dataset)
    if recording.has_windows and (settings is not None or trace or refined is None):
        raise StereocalError(
            f"{recording.name}: {REFINED_ONLY}, without settings of the paper's methods."
        )
    if len(recording.cameras) > 2 or recording.has_windows:
        if settings is not None or trace or refined is None:
            raise StereocalError(
                f"{recording.name}: it has {len(recording.cameras)} cameras. Settings of the "
                "paper's methods are of two: choose them with `recording.pair(first, second)`."
            )
        run_of_all = Run(recording, refined, begin=progress or (lambda _: None))
        return answering(CalibratedRig, run_of_all.bare_rig)
    pair, settings = pair_of(dataset), settings or CalibrationSettings()
    refuse_unknown_frames(settings, [pair])
    run = PairRun(pair, settings, refined, trace=trace)
    if progress is not None:
        run.progress = progress
    return answering(CalibrationRun, run.calibration)


@dataclass(frozen=True, eq=False, repr=False)
class Validation(TableAnswer):
    """How often a wrong pair is accepted and how far off lengths are, on held-out frames."""

    evaluation: Evaluation

    @cached_property
    def by_dataset(self) -> dict[str, dict[Method, MethodSummary]]:
        """The figures of each data set, by its name."""
        of_each = summarise_all(list(self.evaluation.names), self.evaluation.runs)[1]
        return {name: dict(summaries) for name, summaries in of_each.items()}

    @property
    def summaries(self) -> dict[Method, MethodSummary]:
        """The figures by method, all data sets pooled."""
        return self.evaluation.summaries

    @property
    def answer(self) -> list[str]:
        runs, sets = sum(map(len, self.evaluation.runs)), len(self.evaluation.names)
        counts = f"{count(runs, 'run')} of {count(sets, 'data set')}."
        return [counts, validation_answer(self.summaries)]

    def to_dataframe(self) -> pd.DataFrame:
        """A row a method, all data sets pooled, then a row a data set and method."""
        every = {"all": self.summaries, **(self.by_dataset if len(self.by_dataset) > 1 else {})}
        rows = {
            (name, method): _flat(figures.to_json())
            for name, methods in every.items()
            for method, figures in methods.items()
        }
        return pd.DataFrame(rows).T.rename_axis(["data set", "method"])

    @checked
    def plot(self, look: Literal["methods", "data sets"] = "methods") -> go.Figure:
        """The paper's figure: residual, reprojection and 3D error of each method; or the figures
        of each data set."""
        if look == "data sets":
            return draw("comparison.plot_comparison", self.by_dataset)
        return draw("validation.plot_validation", self.summaries)


def _flat(figures: dict[str, Any]) -> dict[str, Any]:
    """Figures with their intervals in columns of their own."""
    flat: dict[str, Any] = {}
    for name, value in figures.items():
        name = name.removesuffix("_interval")
        parts = value.items() if isinstance(value, dict) else [("value", value)]
        flat |= {name if part == "value" else f"{name}_{part}": figure for part, figure in parts}
    return flat


@checked
def evaluate(
    recordings: Sequence[Pair | Recording],
    runs: int = 100,
    calibration_frames: int = 20,
    splits: Splits = "frames",
    settings: CalibrationSettings | None = None,
    refined: RefineSettings | None = None,
    executor: Executor | None = None,
) -> Validation:
    """Validate on random splits of one data set or several, as the paper does (Section 6).

    Frames that contradict the others are left out first.

    Args:
        runs: of each data set.
        calibration_frames: of each run.
        refined: settings of the refined method; None: the paper's three.
        executor: None: threads.
    """
    pairs = [pair_of(recording) for recording in recordings]
    if not pairs:
        raise StereocalError("There is no recording to validate on: give one or more.")
    asked = EvaluationSettings(
        settings or CalibrationSettings(), runs, calibration_frames, splits, refined
    )
    refuse_unknown_frames(asked.calibration, pairs)
    for pair in pairs:
        check_stated(refined or RefineSettings(), pair.recording)
    screened = [PairRun(pair, asked.calibration).screening.dataset for pair in pairs]
    with engine() if executor is None else nullcontext(executor) as workers:
        runs_done = evaluate_runs(screened, asked, workers)
    return Validation(
        Evaluation(runs_done, asked, unique_names(pairs), [pair.sha256 for pair in pairs])
    )


@dataclass(frozen=True, eq=False, repr=False)
class CalibratedRig(TableAnswer, RigFile):
    """One rig of three cameras and more: what `rig.json` holds."""

    @property
    def answer(self) -> list[str]:
        sentences = (rig_sentence(self), windows_sentence(self), loops_sentence(self))
        return [*filter(None, sentences), *(f"Note: {note}" for note in rig_notes(self))]

    def to_dataframe(self) -> pd.DataFrame:
        """The cameras with their standard errors."""
        return pd.DataFrame(of_figures("rig_report.camera_table", self))

    @checked
    def plot(self, look: Literal["pairs", "cameras"] = "pairs") -> go.Figure:
        """Which cameras share how many bars; or the cameras in space."""
        return draw(f"rig_report.plot_{'cameras' if look == 'cameras' else 'rig_graph'}", self)


@checked
def calibrate_rig(
    recording: Recording, time_offsets: bool | None = None, baseline_sigma_m: float | None = None
) -> CalibratedRig:
    """Calibrate all cameras of a recording as one rig.

    Args:
        time_offsets: whether to bring the cameras into step; None: where it is significant.
        baseline_sigma_m: standard error of the measured baselines.

    Raises:
        StereocalError: a camera, its file or its points contradict the others; it says which.
    """
    settings = RefineSettings(baseline_sigma_m=baseline_sigma_m)
    return answering(CalibratedRig, Run(recording, settings, time_offsets).bare_rig)
