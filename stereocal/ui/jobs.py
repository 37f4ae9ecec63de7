"""Background jobs: they continue when the page is left, and can be cancelled.

Jobs are stored in the project (`projects.jobs`). If the server ends before a job does, its page
offers to resume it.
"""

import logging
import os
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Literal, ParamSpec, TypeVar

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.projects import jobs as stored_jobs
from stereocal.projects.files import Store
from stereocal.projects.jobs import Checkpoints, Record, RunningJob
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings
from stereocal.system.executors import Cluster, cluster, scheduler_of
from stereocal.system.tasks import EndingError
from stereocal.ui.menu import button_type
from stereocal.ui.messages import ErrorsShown, callback, clear_refusal, show_stale
from stereocal.ui.texts import escape_markdown

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
    "trade_off",
    "rig",
]
UNFORESEEN = "Unexpected error. Earlier results are unchanged; the server's log says more."
UNEVEN = "steps"
"""A stage whose parts take differently long: it has no time left to state."""
_LOG = logging.getLogger(__name__)


@dataclass
class Job:
    """A job of this server. Its thread writes; pages only read."""

    stages: tuple[str, ...]
    """What is counted, in order: a progress bar each."""
    executor: Executor
    """Computes its tasks."""
    at: int = 0
    total: int = 0
    done: int = 0
    state: str = "running"
    """running, done, cancelled, failed, or interrupted by the end of the server."""
    sentence: str = ""
    """Why it failed."""
    cancelled: bool = False
    kept: RunningJob | None = None
    """The stored job; None for work done while the page is drawn."""
    started: float = field(default_factory=time.monotonic)
    begun_with: int = 0
    """How much of the stage was done before `started`."""

    def begin(self, stage: str) -> None:
        """Begin a stage."""
        self.at, self.done, self.total = self.stages.index(stage), 0, 0
        self.started, self.begun_with = time.monotonic(), 0

    def progress(self, done: int, total: int) -> None:
        """Report how much of the stage is done."""
        if self.total == 0 and done > 1:
            # Checkpoints, or a first chunk: no measure of the speed.
            self.started, self.begun_with = time.monotonic(), done
        self.done, self.total = done, total
        if self.kept is not None and not self.kept.progress(self.at, done, total):
            self.cancelled = True

    def checkpoints(
        self, stage: str, pack: Callable[[T], bytes | None], unpack: Callable[[bytes], T]
    ) -> Checkpoints[T] | None:
        """The checkpoints of a stage; None for a job that is not stored."""
        return None if self.kept is None else self.kept.checkpoints(stage, pack, unpack)

    @property
    def digest(self) -> str:
        """As `Work.digest`; empty for a job that is not stored."""
        return "" if self.kept is None else self.kept.record.digest


@dataclass(frozen=True)
class Work:
    """The work that a page asks for."""

    project: Project
    kind: Kind
    stages: tuple[str, ...]
    """What is counted, in words: "photographs read"."""
    about: Mapping[str, Any]
    """All that the result depends on, as JSON: digests of inputs, and settings."""
    run: Callable[[Job], bool]
    """Does the work, calls `Job.progress`, checks `Job.cancelled`, and stores the result in the
    project. False if cancelled."""

    @property
    def digest(self) -> str:
        """Identifies the work."""
        return stored_jobs.digest_of(self.kind, self.about)


@st.cache_resource(show_spinner=False)
def pool() -> ThreadPoolExecutor:
    """The server's thread pool, shared by all sessions; jobs take turns (`system.tasks`)."""
    return ThreadPoolExecutor(ServerSettings.from_environment().workers)


@st.cache_resource(show_spinner=False, validate=lambda found: found.is_connected)
def _cluster(address: str) -> Cluster:
    return cluster(address)


def compute(function: Callable[P, T], /, *arguments: P.args, **named: P.kwargs) -> T:
    """Compute in the pool while a page is drawn, so that sessions add no threads."""
    return pool().submit(function, *arguments, **named).result()


@st.cache_resource(show_spinner=False)
def _jobs() -> dict[tuple[Store, Kind], Job]:
    """The last job of each kind of each project that this server ran."""
    return {}


def job_of(project: Project, kind: Kind) -> Job | None:
    """The last job of this kind; None before the first."""
    return _jobs().get((project.database, kind))


def is_running(project: Project, kind: Kind) -> bool:
    """Whether such a job is running, here or on another server with the same projects."""
    job = job_of(project, kind)
    if job is not None and job.state == "running":
        return True
    found = stored_jobs.find(project.database, kind)
    return found is not None and found[0] == "running"


def has_failed(project: Project, kind: Kind) -> bool:
    """Whether the last job of this kind ended in an error."""
    job, found = job_of(project, kind), stored_jobs.find(project.database, kind)
    if found is not None:
        return found[0] == "failed"
    return job is not None and job.state == "failed"


def can_go_on(work: Work) -> bool:
    """Whether this work was interrupted."""
    found = stored_jobs.find(work.project.database, work.kind)
    return found is not None and found[0] == "interrupted" and found[1].digest == work.digest


def start(work: Work) -> None:
    """Begin or resume a job, unless one of its kind is running (a callback)."""
    if is_running(work.project, work.kind):
        return
    job, database = Job(work.stages, pool()), work.project.database
    try:
        job.kept = stored_jobs.begin(database, work.kind, work.stages, work.about)
        if job.kept is None:
            return
    except StereocalError as error:
        job.sentence, job.state = str(error), "failed"
    _jobs()[database, work.kind] = job
    if job.kept is not None:
        threading.Thread(target=_drive, args=(job, work.run), daemon=True, name=work.kind).start()


def start_button(
    work: Work, label: str, key: str, *, primary: bool = True, disabled: bool = False
) -> None:
    """The button that begins a job."""

    def press() -> None:
        clear_refusal()
        start(work)

    disabled = disabled or is_running(work.project, work.kind)
    st.button(label, key=key, type=button_type(primary), disabled=disabled, on_click=press)


def _drive(job: Job, run: Callable[[Job], bool]) -> None:
    kept, state = job.kept, "failed"
    assert kept is not None
    try:
        if address := scheduler_of(os.environ):
            job.executor = _cluster(address)  # in the thread: it may take seconds to answer
        ended = "done" if run(job) else "cancelled"
        kept.end()
        state = ended
    except StereocalError as error:
        job.sentence = str(error)
        kept.fail(job.sentence)
    except EndingError:  # after a restart its page offers to resume it
        state = "interrupted"
    except Exception:
        # Otherwise no page would show an error of this thread.
        _LOG.exception("A job ended in an error that nobody foresaw.")
        job.sentence = UNFORESEEN
        kept.fail(job.sentence)
    finally:
        job.kept, job.state = None, state


def bring_up_to_date(
    work: Work,
    current: bool,
    short: bool,
    spinner: str,
    label: str,
    key: str,
    cancelled: str,
    stale: str = "",
) -> None:
    """Compute short work at once; for long work show a button and progress.

    Args:
        current: whether its result is stored.
        stale: what has changed since the result that is shown; empty if nothing, or without one.
        spinner, label, key: of short work, and of the button.
        cancelled: message for a cancelled job.
    """
    if current:
        discard_finished(work)
    elif short:
        with ErrorsShown(), st.spinner(spinner):
            work.run(Job(work.stages, pool()))
            stale = ""
        show_stale(stale)
    else:
        show_stale(stale)
        if not (is_running(work.project, work.kind) or can_go_on(work)):
            start_button(work, label, key)
    show_job(work.project, work.kind, cancelled, work)


def show_job(project: Project, kind: Kind, cancelled: str, work: Work | None) -> None:
    """Show a running job with a Cancel button, or how the last one ended.

    Args:
        cancelled: message for a cancelled job.
        work: the work that the page asks for now: an interrupted job resumes only if it is equal.
    """
    if is_running(project, kind):
        # Only now: a permanent timer would interrupt every longer run of the page.
        _show_progress(project, kind)
        return
    job, found = job_of(project, kind), stored_jobs.find(project.database, kind)
    if found is not None and found[0] == "interrupted":
        _show_interrupted(project, kind, found[1], work)
    elif found is not None:
        st.error(escape_markdown(found[1].sentence))
    elif job is not None and job.state == "failed":
        st.error(escape_markdown(job.sentence))
    elif job is not None and job.state == "cancelled":
        st.info(cancelled)


def _show_interrupted(project: Project, kind: Kind, record: Record, work: Work | None) -> None:
    same = work is not None and record.digest == work.digest
    so_far = "It had just begun."
    if record.total:
        stage = record.stages[record.at].split()[0]
        step = f" in step {record.at + 1} of {len(record.stages)}" * (len(record.stages) > 1)
        so_far = f"{record.done} of {record.total} {stage} were finished{step}."
    if not same:
        so_far += (
            " The data, the settings or the program have changed since, so it can only be started "
            "again; or set them back, and it can go on."
        )
    st.warning(f"The server stopped while this ran. {so_far}")
    with st.container(horizontal=True):
        if same:
            st.button("Go on", type="primary", key=f"go_on_{kind}", on_click=start, args=(work,))
        away = callback(partial(discard, project, kind))
        st.button("Discard", key=f"discard_{kind}", on_click=away)


def discard(project: Project, kind: Kind) -> None:
    """Delete a job that is not running, with its checkpoints."""
    stored_jobs.discard(project.database, kind)
    _jobs().pop((project.database, kind), None)


def abandon(project: Project, kind: Kind) -> None:
    """Cancel a running job, or delete its checkpoints."""
    if is_running(project, kind):
        stored_jobs.ask_to_stop(project.database, kind)
    else:
        discard(project, kind)


def discard_finished(work: Work) -> None:
    """Delete an interrupted job whose result is already stored."""
    if can_go_on(work):
        discard(work.project, work.kind)


@st.fragment(run_every=0.5)
def _show_progress(project: Project, kind: Kind) -> None:
    """Of a job of this server, or of another with the same projects."""
    if not is_running(project, kind):
        st.rerun()
    job, left = job_of(project, kind), ""
    shown: Job | Record | None = job
    if job is None or job.state != "running":
        found = stored_jobs.find(project.database, kind)
        shown, key = found and found[1], f"stop_{kind}"
        stop: Callable[[], None] = callback(partial(abandon, project, kind))
    else:
        key, stop = f"cancel_{kind}", partial(setattr, job, "cancelled", True)
        counted = job.done - job.begun_with
        if counted > 0 and job.stages[job.at] != UNEVEN:
            pace = (time.monotonic() - job.started) / counted
            left = f", about {pace * (job.total - job.done):.0f} s left"
    if shown is None:
        return
    for number, stage in enumerate(shown.stages):
        if number < shown.at:
            st.progress(1.0, f"{stage.capitalize()}: all")
        elif number == shown.at and (shown.done or (shown.total and stage == UNEVEN)):
            words = f"{shown.done} of {shown.total} {stage}{left}"
            st.progress(shown.done / max(shown.total, 1), words)
        else:
            st.progress(0.0, "Starting" if number == shown.at else f"{stage.capitalize()}: not yet")
    st.button("Cancel", key=key, on_click=stop)
