"""Run the tasks of a long computation on any executor.

Only a few tasks of a job are submitted at once, so jobs that share a pool take turns: a new job
waits only for those few tasks of the others.
"""

from collections import deque
from collections.abc import Callable, Generator, Iterable
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from stereocal.errors import StereocalError
from stereocal.system.executors import tasks_at_once

T = TypeVar("T")
Progress = Callable[[int, int], None]
"""Called with the amount done and the total."""
SPARE = 1
"""Submitted tasks of a job beyond the number of workers, so that no worker is idle."""
AHEAD = 64
"""Tasks whose results may wait for an earlier one."""
POLL_S = 0.2
"""Interval in which cancellation is polled."""


@dataclass(frozen=True)
class Task(Generic[T]):
    """A function call; function and arguments can be pickled."""

    key: str
    """Identifies everything that the result depends on."""
    function: Callable[..., T]
    arguments: tuple[Any, ...]
    size: int = 1
    """Amount of progress: runs, rows."""


class Pieces(Protocol[T]):
    """A checkpoint: results of finished tasks by their keys."""

    def get(self, key: str, /) -> T | None:
        """The result; None if it is not stored or cannot be read."""

    def keep(self, key: str, piece: T, /) -> None:
        """Store a result."""


class StoppedError(Exception):
    """The work was cancelled."""


class EndingError(Exception):
    """The program is shutting down and takes no more tasks."""


def run_tasks(
    tasks: Iterable[Task[T]],
    executor: Executor | None,
    total: int,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    pieces: Pieces[T] | None = None,
    ahead: int = AHEAD,
) -> Generator[tuple[Task[T], T], None, None]:
    """Yield each task with its result, in the order of the tasks.

    Iterate inside `contextlib.closing`, which cancels tasks that have not begun.

    Args:
        tasks: consumed one by one, as workers become free.
        executor: None: the calling thread.
        total: sum of the sizes of all tasks, for `progress`, which is called as each task ends.
        cancelled: polled at least every `POLL_S`.
        pieces: checkpoint to read and store results.
        ahead: largest number of tasks begun but not yielded, which limits memory.

    Raises:
        StoppedError: `cancelled` returned True.
        EndingError: the program is shutting down.
        StereocalError: a worker process or the cluster was lost.
        Also any exception of a task, when its turn comes.
    """
    work = _Work(tasks, executor, pieces, ahead)
    done = 0
    try:
        while True:
            _stop_if(cancelled)
            for task in (*work.begin(), *work.ended()):
                done += task.size
                if progress is not None:
                    progress(done, total)
                _stop_if(cancelled)  # several may have ended at once
            if not work.begun:
                return
            while work.begun and work.begun[0][1].done():
                task, future = work.begun.popleft()
                yield task, _result(future)
    finally:
        for _, future in work.begun:
            future.cancel()


def _stop_if(cancelled: Callable[[], bool] | None) -> None:
    if cancelled is not None and cancelled():
        raise StoppedError


class _Work(Generic[T]):
    def __init__(
        self,
        tasks: Iterable[Task[T]],
        executor: Executor | None,
        pieces: Pieces[T] | None,
        ahead: int,
    ) -> None:
        self._tasks = iter(tasks)
        self._executor = executor
        self._most = 1 if executor is None else tasks_at_once(executor) + SPARE
        self._pieces = pieces
        self._ahead = ahead
        self._at_work: dict[Future[T], Task[T]] = {}
        self.begun: deque[tuple[Task[T], Future[T]]] = deque()
        """In the order of the tasks, until they are yielded."""

    def begin(self) -> list[Task[T]]:
        """Begin as many tasks as allowed; returns those found in the checkpoint."""
        finished = []
        while len(self._at_work) < self._most and len(self.begun) < self._ahead:
            task = next(self._tasks, None)
            if task is None:
                break
            kept = None if self._pieces is None else self._pieces.get(task.key)
            if kept is not None:
                self.begun.append((task, _ready(kept)))
                finished.append(task)
            else:
                future = self._submit(task)
                self.begun.append((task, future))
                self._at_work[future] = task
        return finished

    def ended(self) -> list[Task[T]]:
        """Wait up to `POLL_S` for tasks to end and store their results; returns these tasks."""
        finished = []
        wait(self._at_work, POLL_S, FIRST_COMPLETED)
        for future in [future for future in self._at_work if future.done()]:
            task = self._at_work.pop(future)
            if not future.cancelled() and future.exception() is None:
                if self._pieces is not None:
                    self._pieces.keep(task.key, future.result())
                finished.append(task)
        return finished

    def _submit(self, task: Task[T]) -> Future[T]:
        if self._executor is None:
            return _ready(task.function(*task.arguments))
        try:
            return self._executor.submit(task.function, *task.arguments)
        except BrokenExecutor as error:
            raise _lost(error) from error
        except RuntimeError as error:
            raise EndingError from error


def _ready(found: T) -> Future[T]:
    future: Future[T] = Future()
    future.set_result(found)
    return future


def _result(future: Future[T]) -> T:
    try:
        return future.result()
    except (BrokenExecutor, CancelledError) as error:
        raise _lost(error) from error
    except Exception as error:
        if type(error).__module__.partition(".")[0] != "distributed":
            raise
        raise _lost(error) from error


def _lost(error: BaseException) -> StereocalError:
    """The error for a killed worker or a lost cluster."""
    return StereocalError(
        f"A worker ended before its task was done ({type(error).__name__}): if memory is short, "
        "use fewer workers, then start again."
    )
