"""The one press of the Calibrate page: screening, all methods, forecast, and validation.

Short work is done while the page is drawn; longer work is a job. The job validates the calibration
that is stored when it starts; if another one is stored meanwhile, it begins again with that one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.evaluation.evaluate import EvaluationSettings
from stereocal.formats.evaluation_files import Evaluation
from stereocal.projects.inputs import Inputs
from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.ui import jobs
from stereocal.ui.messages import ErrorsShown
from stereocal.ui.refined import ANSWER_STEPS, answer_for, refined_for
from stereocal.ui.screening import is_long
from stereocal.ui.validation import INSTANT, digests_of, evaluated, kept_protocol
from stereocal.workflow import calibrate

KIND: jobs.Kind = "calibration"
STAGES = ("steps", "runs")
STEPS = ("screening", "essential", "2d", "3d", *ANSWER_STEPS)
FEWEST_TO_VALIDATE = 5


def work_of(
    project: Project, inputs: Inputs, dataset: Dataset, settings: CalibrationSettings
) -> jobs.Work:
    """The work of a press with these inputs and settings."""
    protocol = kept_protocol(project, [dataset])
    large = is_long(dataset)
    about = {"dataset": digests_of(dataset), "settings": [settings.to_json(), protocol.to_json()]}

    def run(job: jobs.Job) -> bool:
        def step(name: str) -> None:
            job.progress(STEPS.index(name), len(STEPS))

        if large:
            job.begin("steps")
            found = _calibrate(project, inputs, dataset, settings, protocol.refined, step)
            if protocol.refined is not None:
                answer_for(found, protocol.refined, None, step)
        job.begin("runs")
        return _validate(project, protocol, job)

    return jobs.Work(project, KIND, STAGES if large else STAGES[1:], about, run)


def press(
    project: Project,
    inputs: Inputs,
    dataset: Dataset,
    settings: CalibrationSettings,
    errors_first: bool = False,
) -> None:
    """Calibrate and validate, at once or in a job.

    Args:
        errors_first: show the errors of the methods before forecast and validation are there.

    Raises:
        StereocalError: the data do not determine the pose; the last result stays.
    """
    work = work_of(project, inputs, dataset, settings)
    if is_long(dataset):
        jobs.start(work)
        return
    protocol, frames = kept_protocol(project, [dataset]), len(dataset.correspondences.frames)
    with st.spinner("Calibrating."):
        _calibrate(project, inputs, dataset, settings, protocol.refined)
    if frames < FEWEST_TO_VALIDATE:
        _conclude(project, protocol)
    elif errors_first or protocol.runs * frames / 25 > INSTANT:
        jobs.start(work)
    else:
        with ErrorsShown(lambda why: st.info(f"Not validated: {why}")), st.spinner("Validating."):
            _validate(project, protocol, jobs.on_page(STAGES))


def _calibrate(
    project: Project,
    inputs: Inputs,
    dataset: Dataset,
    settings: CalibrationSettings,
    of_refined: RefineSettings | None,
    step: Callable[[str], None] = lambda _: None,
) -> Calibration:
    found = jobs.compute(calibrate, dataset, settings, trace=True, progress=step, refined=None)
    if of_refined is not None:
        step("refined")
        found = replace(found, refined=refined_for(found, of_refined))
    project.keep_calibration(found, inputs)
    return found


def _validate(project: Project, protocol: EvaluationSettings, job: jobs.Job) -> bool:
    """Evaluate the stored calibration and store the result; False if cancelled."""

    def is_over(digest: str | None) -> bool:
        return job.cancelled or project.calibration_digest != digest

    while True:
        digest, calibration = project.calibration_digest, project.calibration
        if calibration is None:
            return False
        if project.calibration_evaluation is None:
            kept = calibration.screening.dataset
            most = max(len(kept.correspondences.frames) - 2, 1)
            settings = replace(
                protocol,
                calibration=replace(calibration.settings, calibration_frames=None),
                calibration_frames=min(protocol.calibration_frames, most),
                splits="runs",  # of which the tiles are, whatever Validate shows
            )
            runs = evaluated([kept], settings, job, partial(is_over, digest))
            if runs is not None:
                own = [calibration.dataset.sha256]
                found = Evaluation(runs, settings, [kept.name], own)
                project.keep_evaluation(found, of_calibration=True)
            elif job.cancelled:
                _conclude(project, protocol)
                return False
        elif project.calibration_digest == digest:
            _conclude(project, protocol)
            return True


def _conclude(project: Project, protocol: EvaluationSettings) -> None:
    """Make the answer, so that the page has it at once, and store what it recommends."""
    calibration = project.calibration
    assert calibration is not None and protocol.refined is not None
    found = answer_for(calibration, protocol.refined, project.calibration_evaluation)
    project.keep_recommended(found.recommendation.match.method, found.recommendation.measure.method)


def show_progress(project: Project, work: jobs.Work | None) -> None:
    """Show the job of a press, if there is one.

    A result that was stored while the last job was ending was too late for it, and too early for a
    new one: that begins now.
    """
    job = jobs.job_of(project, KIND)
    done = job is not None and job.state == "done"
    if work is not None and done and project.calibration and not project.calibration_evaluation:
        jobs.start(work)
    jobs.show_job(project, KIND, "Cancelled: the result has no validation.", work)
