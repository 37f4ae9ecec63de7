"""The one press of the Calibrate page: screening, all methods, forecast, and validation; of three
cameras and more all of them together first, then the pair that is looked at.

A press starts a job, which takes the place of one that runs, and the page follows it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.calibration.mistakes import INTO_WATER
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.fit.in_words import rig_notes
from stereocal.fit.results import Calibration
from stereocal.fit.rig_file import RigFile
from stereocal.projects.application import Use
from stereocal.projects.inputs import Inputs
from stereocal.projects.project import Project
from stereocal.rig.pair import Pair
from stereocal.rig.window import THICKNESS_M, StatedWindow
from stereocal.system.latest import is_made
from stereocal.system.made_from import changed
from stereocal.system.tasks import StoppedError
from stereocal.ui import jobs
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.forms import form_values, refine_settings
from stereocal.ui.messages import ErrorsShown, button, clear_refusal, end_here, readable, show_stale
from stereocal.ui.rig import ask_time_offsets, rig_parts, rig_work, show_rig
from stereocal.ui.screening import is_long
from stereocal.ui.texts import escape_markdown
from stereocal.ui.validation import kept_protocol
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.made_from import calibration_parts, parts_of_calibration
from stereocal.workflow.pair_run import STEPS, PairRun

PAPER_SET_FOR: Mapping[Use, Method] = {"matching": "2d", "measuring": "3d"}
KIND: jobs.Kind = "calibration"
NOT_VALIDATED = "Cancelled: the result has no validation."
RIG_CANCELLED = "Cancelled. The last result, if any, is unchanged."
STAGES = ("steps", "runs")
FEWEST_TO_VALIDATE = 5
ResultState = tuple[str | None, bool, bool]


@dataclass(frozen=True, eq=False)
class Press:
    """What a press calibrates and validates: two cameras, of a rig those of the chosen pair."""

    project: Project
    inputs: Inputs
    dataset: Pair
    settings: CalibrationSettings
    protocol: EvaluationSettings
    """The settings of the validation."""

    @classmethod
    def of(cls, project: Project) -> "Press":
        """The press of a project with its present data and settings.

        Raises:
            StereocalError: an input is missing.
        """
        inputs = project.inputs
        if (dataset := project.dataset_of(inputs)) is None:
            raise StereocalError(f"Still missing: {', '.join(inputs.missing)}.")
        settings = CalibrationSettings.from_json(form_values(project, dataset))
        return cls(project, inputs, dataset, settings, kept_protocol(project, [dataset]))

    @property
    def work(self) -> jobs.PageWork:
        """The job of this press."""
        return jobs.PageWork(self.project, KIND, STAGES, self._run)

    def _run(self, job: jobs.Job) -> None:
        def step(name: str) -> None:
            job.progress(STEPS.index(name), len(STEPS))

        job.begin("steps")
        refined = self.protocol.refined
        run = PairRun(self.dataset, self.settings, refined, trace=True, progress=step)
        calibration = run.calibration
        step("forecast")
        self.project.keep_calibration(calibration, self.inputs)
        digest = self.project.calibration_digest
        job.begin("runs")
        try:
            if len(self.dataset.correspondences.frames) >= FEWEST_TO_VALIDATE:
                self._validate(job, digest)
        except StereocalError as error:
            job.note = f"Not validated: {error}"
        finally:  # without a validation too
            self._conclude(digest)

    def _validate(self, job: jobs.Job, digest: str | None) -> None:
        """Evaluate the calibration, and store the result, unless another one is stored by then."""
        if (run := self.project.run) is None:
            raise StoppedError
        most = max(len(run.screening.dataset.correspondences.frames) - 2, 1)
        settings = replace(
            self.protocol,
            calibration=replace(run.settings, calibration_frames=None),
            calibration_frames=min(self.protocol.calibration_frames, most),
            splits="runs",  # of which the tiles are, whatever Validate shows
        )
        evaluation = run.validate(settings, job.executor, job.progress)
        if self.project.calibration_digest != digest:
            raise StoppedError
        self.project.keep_evaluation(evaluation, of_calibration=True)

    def _conclude(self, digest: str | None) -> None:
        """Make the answer, so that the page has it at once, and store what it recommends, unless
        another result is stored by then."""
        if (answer := self.project.answer) is None:
            return
        compute_all(answer)
        use = answer.recommendation
        with self.project.results.transaction():
            if self.project.calibration_digest == digest:
                self.project.keep_recommended(use.match.method, use.measure.method)


def work_of(project: Project) -> jobs.PageWork:
    """The work of a press: of all cameras of a rig, unless the project is of a pair of it."""
    return rig_work(project) if project.is_rig and not project.pair else Press.of(project).work


def press(project: Project) -> None:
    """Calibrate as the project says now, in place of what runs (a callback)."""
    clear_refusal()
    jobs.start(work_of(project), anew=True)


def show_press(project: Project, only_if_stale: bool = False) -> None:
    """What has changed since the result, and the button; its progress in the place of both.

    A pair of a rig is calibrated unasked, unless that was tried.
    """
    all_cameras = project.is_rig and not project.pair
    kind: jobs.Kind = "rig" if all_cameras else KIND
    last_job = jobs.job_of(project, kind)
    tried = last_job is not None and last_job.state in ("failed", "cancelled")
    if project.pair and project.calibration_digest is None and not tried:
        with ErrorsShown():
            jobs.start(work_of(project))
    if not only_if_stale:
        jobs.show_job(project, kind, RIG_CANCELLED if all_cameras else NOT_VALIDATED)
    if jobs.is_running(project, kind):
        return
    is_there = readable(lambda: project.rig if all_cameras else project.calibration, warn=False)
    if not only_if_stale:
        failed = last_job is not None and last_job.state == "failed" and last_job.sentence
        _offer_window(project, [failed or "", *_warnings(is_there)])
    stale = changed_since(project) if is_there else ""
    if (only_if_stale or project.pair) and is_there and not stale:
        return
    show_stale(stale)
    if not is_there:
        st.info("No result yet. The settings are good as they are: press Calibrate.")
    label = f"Calibrate{' this pair' if project.pair else ''}{' again' if is_there else ''}"
    key = "run_pair" if project.pair else "run"
    button(label, key, press, project, first=bool(stale) or not is_there)


def _warnings(result: Calibration | RigFile | None) -> Sequence[str]:
    if result is None:
        return ()
    return result.warnings if isinstance(result, Calibration) else rig_notes(result)


def _offer_window(project: Project, messages: Sequence[str]) -> None:
    """A button to calibrate behind a window, if a message says that images are taken through it."""
    if not project.windows and any(INTO_WATER in message for message in messages):
        hint = "One window for all cameras, 10 mm of glass before water, unless *Data* has another."
        label, key = "Calibrate behind a window", "behind_window"
        button(label, key, _behind_window, project, icon="water_drop", help=hint)


def _behind_window(project: Project) -> None:
    """State a window of all cameras, and calibrate again (a callback)."""
    if (recording := project.whole.recording) is not None:
        window = StatedWindow(tuple(recording.cameras), THICKNESS_M)
        project.give({}, windows=[window.to_json()])
        press(project.whole)


def result_state(project: Project) -> ResultState:
    """Which result there is, and whether another one is being computed."""
    computing = jobs.is_running(project, KIND), jobs.is_running(project.whole, "rig")
    return project.calibration_digest, *computing


def changed_since(project: Project) -> str:
    """What was given, stated or set since the result; empty if nothing was, or there is none."""
    with project.database.reading():
        if project.is_rig and not project.pair:
            return changed(*rig_parts(project))
        dataset, result = project.dataset, project.calibration
        if result is None or dataset is None:
            return ""
        settings = CalibrationSettings.from_json(form_values(project, dataset))
        now = calibration_parts(dataset, settings, refine_settings(project, dataset))
        return changed(parts_of_calibration(result), now)


def calibrate_all(project: Project) -> None:
    """The press for all cameras of a rig, and the answer; without one the page ends."""
    top = st.container()
    with st.expander("Settings"):
        ask_time_offsets(project)
    with top:
        show_press(project)
    rig = readable(lambda: project.rig)
    if rig is None:
        if (recording := readable(lambda: project.recording, warn=False)) is not None:
            st.caption(escape_markdown(recording.describe_pairs()))
        end_here()
    show_rig(project, rig)


def offer_again(project: Project) -> None:
    """On other pages: if the calibration is out of date, what changed and the button, as above."""
    if readable(lambda: project.calibration, warn=False) is not None:
        show_press(project, only_if_stale=True)


def final_answer(project: Project) -> PairAnswer | None:
    """The last result with its validation, nothing computed yet.

    Returns:
        None without a result, and while a job validates it: the validation gives the threshold,
        and files that are downloaded before would have another.
    """
    if jobs.is_running(project, KIND):
        return None
    readable(lambda: project.calibration_evaluation)  # tells that it is damaged
    return readable(lambda: project.answer)


def wait_for_answer(project: Project) -> None:
    """Show the job that validates the last result, if one runs."""
    if jobs.is_running(project, KIND):
        st.info("The calibration is being validated: its files come with their thresholds.")
        jobs.show_job(project, KIND, NOT_VALIDATED)


def answer_when_ready(project: Project) -> PairAnswer | None:
    """The last result with its files: at once, or for a long recording from a job, which is shown.

    Returns:
        None while the job runs, or if it did not come to its end.
    """
    answer = final_answer(project)
    if answer is None:
        return None
    if not is_long(answer.run.dataset):
        with st.spinner("Forecasting."):
            compute_all(answer)
    elif not (is_made(answer, "sets") and is_made(answer.run, "advice")):
        _show_job_of_answer(project, answer)
        return None
    return answer


def compute_all(answer: PairAnswer) -> None:
    """Compute what pages show of a run; of a long recording also what takes seconds there."""
    make(answer, "sets")
    if is_long(answer.run.dataset):
        make(answer.run, "advice")


def make(result: PairRun | PairAnswer, step: str) -> None:
    """Compute a step in the pool, unless it is made."""
    if not is_made(result, step):
        jobs.compute(getattr, result, step)


def _show_job_of_answer(project: Project, answer: PairAnswer) -> None:
    """Start the job of the answer, unless it has failed or was cancelled, and show it."""

    def compute(job: jobs.Job) -> None:
        job.progress(0, 1)
        compute_all(answer)

    last_job = jobs.job_of(project, "answer")
    work = jobs.PageWork(project, "answer", ("steps",), compute)
    ended = last_job is not None and last_job.state in ("failed", "cancelled")
    if not ended:  # what was made is kept in memory: after a restart it is made again
        jobs.start(work)
    jobs.show_job(project, "answer", "Cancelled.")
    if ended:
        jobs.start_button(work, "Compute it", "again_answer", primary=False)


def set_in_use(project: Project, use: Use, answer: PairAnswer) -> Field:
    """The set of a result to match or to measure with: as recommended until the user chooses."""
    return setting(project, f"apply_{use}", answer.recommendation.use[use], one_of([*answer.sets]))
