"""Background jobs: they continue when the page is left, and can be cancelled.

A thread of its own drives each job, and hands its tasks to the server's pool (docs/architecture.md
says why). Projects store which jobs run (`projects.jobs`). If the server ends before a job does,
its page says so, and its button begins it again.
"""

import logging
import os
import threading
import time
from collections.abc import Callable
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import nullcontext
from dataclasses import dataclass, field
from functools import cache, partial
from typing import Any, Literal, ParamSpec, TypeVar

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.projects import jobs as stored_jobs
from stereocal.projects.files import Store
from stereocal.projects.jobs import FoundBefore
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings
from stereocal.system.executors import engine, in_background, scheduler_of
from stereocal.system.made_from import Parts, digest_of
from stereocal.system.tasks import POLL_S, EndingError, StoppedError, Task, run_tasks
from stereocal.ui.messages import button, clear_refusal
from stereocal.ui.texts import escape_markdown
from stereocal.ui.warm_up import WARM_UP

P = ParamSpec("P")
T = TypeVar("T")
Kind = Literal[
    "calibration",
    "evaluation",
    "photographs",
    "video",
    "lens_primary",
    "lens_secondary",
    "apply",
    "answer",
    "rig",
]
State = Literal["running", "done", "cancelled", "failed"]
UNFORESEEN = "Unexpected error. Earlier results are unchanged; the server's log says more."
INTERRUPTED = "The server stopped while this ran, and it was not finished. Start it again."
UNEVEN = "steps"
"""A stage whose parts take differently long: it has no time left to state."""
WAIT_S = 1.0
"""How long a page waits for a job that has just begun, so that short work shows its result at once,
and no progress."""
_LOG = logging.getLogger(__name__)


@dataclass(frozen=True)
class PageWork:
    """The work that a page asks for."""

    project: Project
    kind: Kind
    stages: tuple[str, ...]
    """What is counted, in words: "photographs read"."""
    run: Callable[["Job"], bool | None]
    """Does the work, calls `Job.progress`, which ends it if it was cancelled, and stores the result
    in the project. False if there is none."""
    made_from: Parts = field(default_factory=dict)
    """What the result depends on, for pages that compare it."""
    so_far: Any = None
    """What it has found, for its page: `run` adds to it."""
    follows: bool = False
    """Whether its page starts it unasked, at each change of its settings: it takes the place of one
    of other settings at once, one that failed or was cancelled is not begun again, and no project
    stores it."""

    @property
    def digest(self) -> str:
        """Identifies what it is made from."""
        return digest_of({**self.made_from})


@dataclass
class Job:
    """Work that this server does. Its thread writes; pages only read."""

    work: PageWork
    executor: Executor
    """Computes its tasks."""
    stage: int = 0
    """Number of the stage."""
    total: int = 0
    done: int = 0
    state: State = "running"
    sentence: str = ""
    """Why it failed."""
    note: str = ""
    """What its page says of it once it is done."""
    begun: float = field(default_factory=time.monotonic)
    cancelled: bool = False
    started: float = field(default_factory=time.monotonic)
    begun_with: int = 0
    """How much of the stage was done before `started`."""

    def begin(self, stage: str) -> None:
        """Begin a stage."""
        self.stage, self.done, self.total = self.work.stages.index(stage), 0, 0
        self.started, self.begun_with = time.monotonic(), 0

    def progress(self, done: int, total: int) -> None:
        """Report how much of the stage is done; a removed project cancels the job.

        Raises:
            StoppedError: the job was cancelled.
        """
        if self.done == 0 and done > 1:
            # Found before, or a first chunk: no measure of the speed.
            self.started, self.begun_with = time.monotonic(), done
        self.done, self.total = done, total
        # Not `|=`: that would undo a cancellation that comes while the disk is asked.
        if self.work.project.database.marker.exists():
            self.cancelled = True
        if self.cancelled:
            raise StoppedError

    def found_before(self, record_type: Any) -> FoundBefore:
        """What such a search has found if it was not finished."""
        return FoundBefore(self.work.project.results, self.work.kind, record_type)


@cache
def pool() -> ThreadPoolExecutor:
    """The server's thread pool, shared by all sessions; jobs take turns (`system.tasks`)."""
    return ThreadPoolExecutor(ServerSettings.from_environment().workers)


def compute(function: Callable[P, T], /, *arguments: P.args, **named: P.kwargs) -> T:
    """Compute as one task of the pool, so that sessions add no threads."""
    task = Task(partial(function, *arguments, **named), ())
    ((_, result),) = run_tasks([task], pool(), 1)
    return result


JOBS: dict[tuple[Store, Kind], Job] = {}
"""The last job of each kind of each project that this server ran."""
_STARTING = threading.Lock()


def job_of(project: Project, kind: Kind) -> Job | None:
    """The last job of this kind; None before the first."""
    return JOBS.get((project.results, kind))


def is_running(project: Project, kind: Kind) -> bool:
    """Whether such a job is running."""
    job = job_of(project, kind)
    return job is not None and job.state == "running"


def start(work: PageWork, anew: bool = False) -> Job:
    """The job of this work, begun unless one of its kind is running (or, for work that `follows`,
    one made from the same is running, has failed or was cancelled, or one that was pressed runs).

    Args:
        anew: begun in any case, in the place of one that is running.
    """
    key = work.project.results, work.kind
    with _STARTING:
        if (last := JOBS.get(key)) is not None:
            kept_states = ("running", "failed", "cancelled") if work.follows else ("running",)
            same = last.work.made_from == work.made_from or not work.follows
            pressed = last.state == "running" and not last.work.follows
            if ((last.state in kept_states and same) or pressed) and not anew:
                return last
            last.cancelled = True
        job = JOBS[key] = Job(work, pool())
        try:
            if work.follows:
                # An earlier one that a press began, and a stop ended, is of no use now.
                stored_jobs.end(work.project.results, work.kind, keeps=True)
            else:
                stored_jobs.begin(work.project.results, work.kind)
            in_background(_drive, job)
        except StereocalError as error:
            job.sentence, job.state = str(error), "failed"
    return job


def start_button(
    work: PageWork, label: str, key: str, *, primary: bool = True, disabled: bool = False
) -> None:
    """The button that begins a job."""

    def press() -> None:
        clear_refusal()
        start(work, anew=work.follows)

    disabled = disabled or is_running(work.project, work.kind)
    button(label, key, press, first=primary, disabled=disabled)


def _drive(job: Job) -> None:
    """Run a job to its end. That of a server that ends before stays *running* in its project, whose
    page says after a restart that it was interrupted."""
    ended: State = "done"
    try:
        while not WARM_UP.over.wait(POLL_S):  # else this process would compile what others compile
            job.progress(0, 0)
        address = scheduler_of(os.environ)
        with engine(scheduler=address) if address else nullcontext(job.executor) as job.executor:
            if job.work.run(job) is False:
                ended = "cancelled"
    except StoppedError:
        ended = "cancelled"
    except EndingError:
        return
    except StereocalError as error:
        job.sentence, ended = str(error), "failed"
    except Exception:  # otherwise no page would show an error of this thread
        _LOG.exception("A job ended in an error that nobody foresaw.")
        job.sentence, ended = UNFORESEEN, "failed"
    if not threading.main_thread().is_alive():
        return
    # Another may have taken its place.
    if not job.work.follows and job_of(job.work.project, job.work.kind) is job:
        # Photographs may be paired otherwise, which asks for no new search.
        keeps = ended == "failed" or (ended == "done" and job.work.kind == "photographs")
        stored_jobs.end(job.work.project.results, job.work.kind, keeps)
    job.state = ended


def wait_shortly(job: Job) -> None:
    """Wait until a job has ended, if it has just begun and is short."""
    while job.state == "running" and time.monotonic() - job.begun < WAIT_S:
        time.sleep(0.01)


def show_job(project: Project, kind: Kind, cancelled: str) -> None:
    """Show a running job with a Cancel button, or how the last one ended.

    Args:
        cancelled: message for a cancelled job.
    """
    job = job_of(project, kind)
    if job is not None:
        wait_shortly(job)
    if job is not None and job.state == "running":
        # Only now: a permanent timer would interrupt every longer run of the page.
        _show_progress(project, kind, job.stage)
    elif stored_jobs.is_interrupted(project.results, kind):
        st.warning(INTERRUPTED)
        button("Discard", f"discard_{kind}", abandon, project, kind)
    elif job is not None and job.state == "failed":
        st.error(escape_markdown(job.sentence))
    elif job is not None and job.state == "cancelled":
        st.info(cancelled)
    elif job is not None and job.note:
        st.info(escape_markdown(job.note))


def drop_pairs(project: Project) -> None:
    """Cancel and forget the jobs of a rig's pairs, whose results have gone."""
    with _STARTING:
        for place, kind in [*JOBS]:
            of_pair = place.path == project.database.path and place != project.database
            if of_pair and kind in ("calibration", "evaluation", "answer"):
                JOBS.pop((place, kind)).cancelled = True


def abandon(project: Project, kind: Kind) -> None:
    """Cancel a job of this server, and forget how an earlier one ended and what it found."""
    if is_running(project, kind):
        JOBS[project.results, kind].cancelled = True
    else:
        stored_jobs.end(project.results, kind)
        JOBS.pop((project.results, kind), None)


@st.fragment(run_every=0.5)
def _show_progress(project: Project, kind: Kind, stage: int) -> None:
    """How far a job is; the page is drawn again when it ends, or has ended a stage."""
    job, time_left = job_of(project, kind), ""
    if job is None or job.state != "running" or job.stage != stage:
        st.rerun()
    counted, stages = job.done - job.begun_with, job.work.stages
    if counted > 0 and stages[job.stage] != UNEVEN:
        pace = (time.monotonic() - job.started) / counted
        time_left = f", about {pace * (job.total - job.done):.0f} s left"
    for number, named in enumerate(stages):
        if number < job.stage:
            st.progress(1.0, f"{named.capitalize()}: all")
        elif number == job.stage and (job.done or (job.total and named == UNEVEN)):
            words = f"{job.done} of {job.total} {named}{time_left}"
            st.progress(job.done / max(job.total, 1), words)
        else:
            st.progress(
                0.0, "Starting" if number == job.stage else f"{named.capitalize()}: not yet"
            )
    button("Cancel", f"cancel_{kind}", setattr, job, "cancelled", True)
