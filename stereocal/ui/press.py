"""The one press of the Calibrate page: screening, all methods, forecast, and validation; and what
its result tells. No draw of a page may wait for a long recording.

Short work is done while the page is drawn; longer work is a job. The job validates the calibration
that is stored when it starts; if another one is stored meanwhile, it begins again with that one.
"""

from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.fit.results import Calibration
from stereocal.projects.application import Use
from stereocal.projects.inputs import Inputs
from stereocal.projects.project import Project
from stereocal.rig.pair import Pair
from stereocal.system.latest import is_made
from stereocal.system.tasks import StoppedError
from stereocal.ui import jobs
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.forms import form_values, since_calibration
from stereocal.ui.messages import ErrorsShown, button, readable, show_stale
from stereocal.ui.screening import asked_to_calibrate, calibrate_next, is_long
from stereocal.ui.validation import kept_protocol
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import STEPS, PairRun

PAPER_SET_FOR: Mapping[Use, Method] = {"matching": "2d", "measuring": "3d"}
KIND: jobs.Kind = "calibration"
NOT_VALIDATED = "Cancelled: the result has no validation."
STAGES = ("steps", "runs")
FEWEST_TO_VALIDATE = 5
INSTANT = 120
"""Runs of 25 frames that take under a second, and so are computed while the page is drawn."""


@dataclass(frozen=True, eq=False)
class Press:
    """What a press calibrates and validates."""

    project: Project
    inputs: Inputs
    dataset: Pair
    settings: CalibrationSettings

    @cached_property
    def protocol(self) -> EvaluationSettings:
        """Of the validation."""
        return kept_protocol(self.project, [self.dataset])

    @cached_property
    def work(self) -> jobs.PageWork:
        """As a job."""
        large = is_long(self.dataset)

        def run(job: jobs.Job) -> bool:
            def step(name: str) -> None:
                job.progress(STEPS.index(name), len(STEPS))

            if large:
                job.begin("steps")
                self._keep(jobs.compute(getattr, self._run(step), "calibration"))
                if (found := self.project.run) is not None:
                    step("forecast")
                    make(found, "forecast_or_reason")
            job.begin("runs")
            return self._validate(job)

        return jobs.PageWork(self.project, KIND, STAGES if large else STAGES[1:], run)

    def show(self, only_if_stale: bool = False) -> None:
        """Do what was pressed; what has changed since the result, and the button.

        While a job runs, its progress is in the place of the button.
        """
        asked, work = asked_to_calibrate(), None
        errors, place = st.container(), st.empty()
        with ErrorsShown(errors.error):
            if asked is not None:
                with place:  # instead of the button
                    self.press(errors_first=asked == "errors first", note=errors.info)
            work = self.work
        with place.container():
            self._show_button(work, only_if_stale)

    def _show_button(self, work: jobs.PageWork | None, only_if_stale: bool) -> None:
        if not only_if_stale:
            show_progress(self.project, work)
        if jobs.is_running(self.project, KIND):
            return
        result = readable(lambda: self.project.calibration, told=False)
        changed = since_calibration(self.project, result, self.dataset) if result else ""
        if only_if_stale and not changed:
            return
        show_stale(changed)
        if result is None:
            st.info("No result yet. The settings are good as they are: press Calibrate.")
        label = "Calibrate again" if result else "Calibrate"
        button(label, "run", calibrate_next, "all", first=bool(changed) or result is None)

    def press(self, errors_first: bool = False, note: Callable[[str], object] = st.info) -> None:
        """Calibrate and validate, at once or in a job.

        Args:
            errors_first: show the errors of the methods before forecast and validation are there.
            note: shows why there is no validation.

        Raises:
            StereocalError: the data do not determine the pose; the last result stays.
        """
        if is_long(self.dataset):
            jobs.start(self.work)
            return
        with st.spinner("Calibrating."):
            self._keep(jobs.compute(getattr, self._run(), "calibration"))
        frames = len(self.dataset.correspondences.frames)
        if frames < FEWEST_TO_VALIDATE:
            self._conclude()
        elif errors_first or self.protocol.runs * frames / 25 > INSTANT:
            jobs.start(self.work)
        else:
            shown = ErrorsShown(lambda why: note(f"Not validated: {why}"))
            with shown, suppress(StoppedError), st.spinner("Validating."):
                self._validate(jobs.Job(self.work, jobs.pool()))

    def _run(self, step: Callable[[str], None] = lambda _: None) -> PairRun:
        own = self.protocol.refined
        return PairRun(self.dataset, self.settings, own, trace=True, progress=step)

    def _keep(self, calibration: Calibration) -> None:
        self.project.keep_calibration(calibration, self.inputs)

    def _validate(self, job: jobs.Job) -> bool:
        """Evaluate the stored calibration and store the result; False if there is none any more."""
        project = self.project

        def progress(digest: str | None, done: int, total: int) -> None:
            job.progress(done, total)
            if project.calibration_digest != digest:
                raise StoppedError

        while True:
            digest, answer = project.calibration_digest, project.answer
            if answer is None:
                return False
            if answer.evaluation is None:
                run = answer.run
                most = max(len(run.screening.dataset.correspondences.frames) - 2, 1)
                settings = replace(
                    self.protocol,
                    calibration=replace(run.settings, calibration_frames=None),
                    calibration_frames=min(self.protocol.calibration_frames, most),
                    splits="runs",  # of which the tiles are, whatever Validate shows
                )
                try:
                    found = run.validate(settings, job.executor, partial(progress, digest))
                except StoppedError:
                    if job.cancelled:
                        self._conclude()
                        raise
                    continue
                project.keep_evaluation(found, of_calibration=True)
            elif project.calibration_digest == digest:
                self._conclude()
                return True

    def _conclude(self) -> None:
        """Make the answer, so that the page has it at once, and store what it recommends."""
        answer = self.project.answer
        assert answer is not None
        compute_all(answer)
        use = answer.recommendation
        self.project.keep_recommended(use.match.method, use.measure.method)


def offer_again(project: Project, inputs: Inputs, dataset: Pair) -> None:
    """On other pages: if the calibration is out of date, what changed and the button, as above."""
    if readable(lambda: project.calibration, told=False) is not None:
        settings = CalibrationSettings.from_json(form_values(project, dataset))
        Press(project, inputs, dataset, settings).show(only_if_stale=True)


def show_progress(project: Project, work: jobs.PageWork | None) -> None:
    """Show the job of a press, if there is one.

    A result that was stored while the last job was ending was too late for it, and too early for a
    new one: that begins now.
    """
    job = jobs.job_of(project, KIND)
    done = job is not None and job.state == "done"
    if work is not None and done and project.calibration and not project.calibration_evaluation:
        jobs.start(work)
    jobs.show_job(project, KIND, NOT_VALIDATED)


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


def make(of: PairRun | PairAnswer, step: str) -> None:
    """Compute a step in the pool, unless it is made."""
    if not is_made(of, step):
        jobs.compute(getattr, of, step)


def _show_job_of_answer(project: Project, answer: PairAnswer) -> None:
    """Start the job of the answer, unless it has failed or was cancelled, and show it."""

    def compute(job: jobs.Job) -> None:
        job.progress(0, 1)
        compute_all(answer)

    last = jobs.job_of(project, "answer")
    work = jobs.PageWork(project, "answer", ("steps",), compute)
    ended = last is not None and last.state in ("failed", "cancelled")
    if not ended:  # what was made is kept in memory: after a restart it is made again
        jobs.start(work)
    jobs.show_job(project, "answer", "Cancelled.")
    if ended:
        jobs.start_button(work, "Compute it", "again_answer", primary=False)


def set_in_use(project: Project, use: Use, answer: PairAnswer) -> Field:
    """The set of a result to match or to measure with: as recommended until the user chooses."""
    return setting(project, f"apply_{use}", answer.recommendation.use[use], one_of([*answer.sets]))
