"""Long work beside the pages: it goes on when the page is left, and can be cancelled."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field
from typing import Literal

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.project import Project
from stereocal.ui.intake import escape_markdown

Kind = Literal["evaluation", "photographs", "lens_primary", "lens_secondary", "apply"]


@dataclass
class Job:
    """One piece of work under way. The thread that runs it writes; pages only read."""

    stages: tuple[str, ...]
    """What is counted, in the order of the work: a bar each."""
    at: int = 0
    total: int = 0
    done: int = 0
    state: str = "running"
    """running, done, cancelled or failed."""
    sentence: str = ""
    """Why it failed."""
    cancelled: bool = False
    started: float = field(default_factory=time.monotonic)

    def begin(self, stage: str) -> None:
        """Go on to a stage of the work."""
        self.at, self.done, self.total = self.stages.index(stage), 0, 0
        self.started = time.monotonic()

    def progress(self, done: int, total: int) -> None:
        """So much of the stage is done."""
        self.done, self.total = done, total

    @property
    def seconds_left(self) -> float:
        """Of the stage, from the pace so far."""
        return (time.monotonic() - self.started) * (self.total - self.done) / max(self.done, 1)


@st.cache_resource(show_spinner=False)
def pool() -> Executor:
    """The server's one pool of workers: the compiled searches do not block each other."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="runs")


@st.cache_resource(show_spinner=False)
def _jobs() -> dict[tuple[str, Kind], Job]:
    """The last job of each kind of each project."""
    return {}


def job_of(project: Project, kind: Kind) -> Job | None:
    """The last job of this kind; None before the first."""
    return _jobs().get((project.id, kind))


def is_running(project: Project, kind: Kind) -> bool:
    """Whether such a job is under way."""
    job = job_of(project, kind)
    return job is not None and job.state == "running"


def start(
    project: Project, kind: Kind, stages: tuple[str, ...], work: Callable[[Job], bool]
) -> None:
    """Begin a job, unless one of its kind is under way.

    Args:
        stages: what is counted, in words: "photographs read".
        work: does all, calls `Job.progress`, looks at `Job.cancelled`, and keeps what it found in
            the project. False if it was cancelled.
    """
    if is_running(project, kind):
        return
    job = Job(stages)
    _jobs()[project.id, kind] = job
    threading.Thread(target=_drive, args=(job, work), daemon=True, name=kind).start()


def _drive(job: Job, work: Callable[[Job], bool]) -> None:
    try:
        job.state = "done" if work(job) else "cancelled"
    except StereocalError as error:
        job.sentence, job.state = str(error), "failed"
    except Exception as error:
        # Nothing of a thread reaches a page unless it is said here.
        job.sentence, job.state = f"Something unforeseen happened ({error!r}).", "failed"


def show_job(project: Project, kind: Kind, cancelled: str) -> None:
    """Progress with a way to stop, while something runs; how it ended, until the next.

    Args:
        cancelled: what is said of a job that was cancelled.
    """
    job = job_of(project, kind)
    if job is None:
        return
    if job.state == "running":
        # Only now: a timer that is always there would interrupt every longer run of the page.
        _show_progress(job, kind)
    elif job.state == "failed":
        st.error(escape_markdown(job.sentence))
    elif job.state == "cancelled":
        st.info(cancelled)


@st.fragment(run_every=0.5)
def _show_progress(job: Job, kind: Kind) -> None:
    if job.state != "running":
        st.rerun()
    for number, stage in enumerate(job.stages):
        if number < job.at:
            st.progress(1.0, f"{stage.capitalize()}: all")
        elif number == job.at and job.done:
            left = f"{job.done} of {job.total} {stage}, about {job.seconds_left:.0f} s left"
            st.progress(job.done / max(job.total, 1), left)
        else:
            st.progress(0.0, "Starting" if number == job.at else f"{stage.capitalize()}: not yet")
    st.button("Cancel", key=f"cancel_{kind}", on_click=_cancel, args=(job,))


def _cancel(job: Job) -> None:
    job.cancelled = True
