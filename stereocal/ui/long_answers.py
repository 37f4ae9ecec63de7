"""Answers about long recordings: computed in jobs, because no draw of a page may wait for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

import streamlit as st

from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.ui import jobs
from stereocal.ui.messages import readable
from stereocal.ui.refined import (
    ANSWER_STEPS,
    answer_for,
    answer_of,
    curves_of,
    kept_answer,
    kept_curves,
    refine_settings,
)
from stereocal.ui.screening import is_long
from stereocal.verdict.tradeoff import TradeOff
from stereocal.workflow import Answer

T = TypeVar("T")
ANSWER: jobs.Kind = "answer"
TRADE_OFF: jobs.Kind = "trade_off"


def answer_when_ready(project: Project, calibration: Calibration) -> Answer | None:
    """What the stored result tells: at once, or for a long recording from a job, which is shown.

    Returns:
        None while the job runs, or if it did not come to its end.
    """
    if not is_long(calibration.dataset) or jobs.is_running(project, "calibration"):
        return answer_of(project, calibration)
    evaluation = readable(lambda: project.calibration_evaluation)
    settings = refine_settings(project, calibration.dataset)

    def run(job: jobs.Job) -> bool:
        def step(name: str) -> None:
            job.progress(ANSWER_STEPS.index(name), len(ANSWER_STEPS))

        found = answer_for(calibration, settings, evaluation, step)
        # For One set or two, which shows it: 9 s for 20,000 frames.
        return found.outlook is None or bool(found.outlook.advice)

    digest = None if evaluation is None else evaluation.settings.to_json()
    about = {**_about(calibration.dataset, settings), "evaluation": digest}
    work = jobs.Work(project, ANSWER, ("steps",), about, run)
    return _made(lambda: kept_answer(calibration, settings, evaluation), work)


def curves_when_ready(
    project: Project, dataset: Dataset, settings: RefineSettings
) -> TradeOff | None:
    """The trade-off: at once, or for a long recording from a job, as in `answer_when_ready`."""
    if not is_long(dataset):
        with st.spinner("Tracing the trade-off."):
            return curves_of(dataset, settings)

    def run(job: jobs.Job) -> bool:
        return curves_of(dataset, settings, job.progress, lambda: job.cancelled) is not None

    work = jobs.Work(project, TRADE_OFF, ("fits",), _about(dataset, settings), run)
    return _made(lambda: kept_curves(dataset, settings), work)


def _about(dataset: Dataset, settings: RefineSettings) -> dict[str, Any]:
    return {"dataset": dataset.sha256, "settings": settings.to_json()}


def _made(made: Callable[[], T | None], work: jobs.Work) -> T | None:
    """What is made already; else its job is started, unless it has failed or was cancelled."""
    found = made()
    if found is not None:
        return found
    last = jobs.job_of(work.project, work.kind)
    ended = last is not None and last.state in ("failed", "cancelled")
    if not ended:  # what was made is kept in memory: after a restart it is made again
        jobs.start(work)
    jobs.show_job(work.project, work.kind, "Cancelled.", work)
    if ended:
        jobs.start_button(work, "Compute it", f"again_{work.kind}", primary=False)
    return None
