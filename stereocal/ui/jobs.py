"""Long work beside the pages: it goes on when the page is left, and can be cancelled."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, field

import streamlit as st

from stereocal.dataset import Dataset
from stereocal.errors import StereocalError
from stereocal.evaluation import EvaluationSettings, evaluate
from stereocal.evaluation_files import Evaluation, unique_names
from stereocal.project import Project


@dataclass
class Job:
    """One evaluation under way. The thread that runs it writes; pages only read."""

    total: int
    done: int = 0
    state: str = "running"
    """running, done, cancelled or failed."""
    sentence: str = ""
    """Why it failed."""
    cancelled: bool = False
    started: float = field(default_factory=time.monotonic)

    @property
    def seconds_left(self) -> float:
        """From the pace so far."""
        return (time.monotonic() - self.started) * (self.total - self.done) / max(self.done, 1)


@st.cache_resource(show_spinner=False)
def pool() -> Executor:
    """The server's one pool of workers: the compiled searches do not block each other."""
    return ThreadPoolExecutor(os.cpu_count() or 1, thread_name_prefix="runs")


@st.cache_resource(show_spinner=False)
def jobs() -> dict[str, Job]:
    """The last job of each project."""
    return {}


def start(project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings) -> None:
    """Begin an evaluation; its result goes into the project when it is finished."""
    job = Job(total=settings.runs * len(datasets))
    jobs()[project.id] = job
    executor = pool()
    threading.Thread(
        target=_drive, args=(job, project, datasets, settings, executor), daemon=True
    ).start()


def run_now(project: Project, datasets: Sequence[Dataset], settings: EvaluationSettings) -> None:
    """A short evaluation, at once.

    Raises:
        StereocalError: as `evaluation.evaluate`.
    """
    _finish(project, datasets, settings, pool(), lambda _done, _total: None, lambda: False)


def _drive(
    job: Job,
    project: Project,
    datasets: Sequence[Dataset],
    settings: EvaluationSettings,
    executor: Executor,
) -> None:
    def progress(done: int, _total: int) -> None:
        job.done = done

    try:
        whole = _finish(project, datasets, settings, executor, progress, lambda: job.cancelled)
        job.state = "done" if whole else "cancelled"
    except StereocalError as error:
        job.sentence, job.state = str(error), "failed"
    except Exception as error:
        # Nothing of a thread reaches a page unless it is said here.
        job.sentence, job.state = f"Something unforeseen happened ({error!r}).", "failed"


def _finish(
    project: Project,
    datasets: Sequence[Dataset],
    settings: EvaluationSettings,
    executor: Executor,
    progress: Callable[[int, int], None],
    cancelled: Callable[[], bool],
) -> bool:
    runs = evaluate(datasets, settings, executor, progress, cancelled)
    if runs is None:
        return False
    digests = [dataset.sha256 for dataset in datasets]
    project.keep_evaluation(Evaluation(runs, settings, unique_names(datasets), digests))
    return True
