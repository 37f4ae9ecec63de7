"""What the last calibration of a project tells: at once, or of a long recording from a job.

No draw of a page may wait for a long recording.
"""

from collections.abc import Callable, Mapping

import streamlit as st

from stereocal.calibration.methods import Method
from stereocal.projects.application import Use
from stereocal.projects.project import Project
from stereocal.system.latest import is_made
from stereocal.ui import jobs
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.messages import readable
from stereocal.ui.screening import is_long
from stereocal.workflow import Run

PAPER_SET_FOR: Mapping[Use, Method] = {"matching": "2d", "measuring": "3d"}
KIND: jobs.Kind = "calibration"


def final_run(project: Project) -> Run | None:
    """The last result with its validation, nothing computed yet.

    Returns:
        None without a result, and while a job validates it: the validation gives the threshold,
        and files that are downloaded before would have another.
    """
    if jobs.is_running(project, KIND):
        return None
    readable(lambda: project.calibration_evaluation)  # tells that it is damaged
    return readable(lambda: project.run)


def wait_for_answer(project: Project) -> bool:
    """Show the job that validates the last result; False if none runs."""
    if not jobs.is_running(project, KIND):
        return False
    st.info("The calibration is being validated: its files come with their thresholds.")
    jobs.show_job(project, KIND, "Cancelled: the result has no validation.")
    return True


def answer_when_ready(project: Project) -> Run | None:
    """The last result with its files: at once, or for a long recording from a job, which is shown.

    Returns:
        None while the job runs, or if it did not come to its end.
    """
    run = final_run(project)
    if run is None:
        return None

    def compute(job: jobs.Job) -> None:
        job.progress(0, 1)
        compute_all(run)

    if not is_long(run.dataset):
        with st.spinner("Forecasting."):
            compute_all(run)
    elif not (is_made(run, "sets") and is_made(run, "advice")):
        _compute_in_job(project, "answer", "steps", compute)
        return None
    return run


def compute_all(run: Run) -> None:
    """Compute what pages show of a run; of a long recording also what takes seconds there."""
    make(run, "sets", *(["advice"] if is_long(run.dataset) else []))


def make(run: Run, *steps: str) -> None:
    """Compute steps of a run in the pool, unless they are made."""
    for name in steps:
        if not is_made(run, name):
            jobs.compute(getattr, run, name)


def curves_are_ready(project: Project, run: Run) -> bool:
    """Whether the trade-off is traced: at once, or for a long recording in a job, as above."""

    def trace(job: jobs.Job) -> None:
        run.trace_curves(job.progress)

    if not is_long(run.dataset):
        with st.spinner("Tracing the trade-off."):
            make(run, "curves")
    elif not is_made(run, "curves"):
        _compute_in_job(project, "trade_off", "fits", trace)
        return False
    return True


def _compute_in_job(
    project: Project, kind: jobs.Kind, counted: str, compute: Callable[[jobs.Job], None]
) -> None:
    """Start the job, unless it has failed or was cancelled, and show it."""
    work, last = jobs.PageWork(project, kind, (counted,), compute), jobs.job_of(project, kind)
    ended = last is not None and last.state in ("failed", "cancelled")
    if not ended:  # what was made is kept in memory: after a restart it is made again
        jobs.start(work)
    jobs.show_job(project, kind, "Cancelled.")
    if ended:
        jobs.start_button(work, "Compute it", f"again_{kind}", primary=False)


def set_in_use(project: Project, use: Use, run: Run) -> Field:
    """The set of a result to match or to measure with: as recommended until the user chooses."""
    return setting(project, f"apply_{use}", run.recommendation.use[use], one_of([*run.sets]))
