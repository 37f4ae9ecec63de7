"""Long computations task by task, on any executor: the one loop that all long work goes through.

Few tasks of a job are handed to the executor at once. So several jobs that share one pool of
threads take turns, however much is left of each: one that begins waits for those few of the others.
"""

from __future__ import annotations

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
"""Called with what is done, and all."""
SPARE = 1
"""Tasks of a job that wait for a worker, so that no worker waits for a task."""
AHEAD = 64
"""Tasks of which the results may wait for an earlier one."""
LOOK_S = 0.2
"""So often it is asked whether the work was cancelled, also while no task ends."""


@dataclass(frozen=True)
class Task(Generic[T]):
    """A call to be made; function and arguments can be pickled."""

    key: str
    """Tells all that the result depends on."""
    function: Callable[..., T]
    arguments: tuple[Any, ...]
    size: int = 1
    """What progress counts: runs, rows."""


class Pieces(Protocol[T]):
    """Finished pieces by the keys of their tasks."""

    def get(self, key: str, /) -> T | None:
        """The piece; None where it has not been finished, or cannot be read."""

    def keep(self, key: str, piece: T, /) -> None:
        """Keep a finished piece."""


class StoppedError(Exception):
    """Somebody cancelled the work."""


class EndingError(Exception):
    """The program ends, and takes no more tasks."""


def run_tasks(
    tasks: Iterable[Task[T]],
    executor: Executor | None,
    total: int,
    progress: Progress | None = None,
    cancelled: Callable[[], bool] | None = None,
    pieces: Pieces[T] | None = None,
    ahead: int = AHEAD,
) -> Generator[tuple[Task[T], T], None, None]:
    """Each task with its result, in the order of the tasks.

    Args:
        tasks: taken one by one, when there is room for one.
        executor: None computes here.
        total: the sizes of all tasks together, for `progress`, which is called as each task ends.
        cancelled: asked at least every `LOOK_S`.
        pieces: results of such tasks that were kept, and where more are kept.
        ahead: so many tasks at most have begun and not been yielded: a limit on memory.

    When it is closed, what has not begun is dropped: iterate inside `contextlib.closing`.

    Raises:
        StoppedError: `cancelled` said so.
        EndingError: the program ends.
        StereocalError: a worker process or the cluster was lost.
        What a task raises, in its turn.
    """
    work = _Work(tasks, executor, pieces, ahead)
    done = 0
    try:
        while True:
            if cancelled is not None and cancelled():
                raise StoppedError
            for task in (*work.begin(), *work.ended()):
                done += task.size
                if progress is not None:
                    progress(done, total)
            if not work.begun:
                return
            while work.begun and work.begun[0][1].done():
                task, future = work.begun.popleft()
                yield task, _result(future)
    finally:
        for _, future in work.begun:
            future.cancel()


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
        """Begin as many tasks as there is room for; those that had been finished before."""
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
        """Wait a moment for tasks to end, and keep their results."""
        finished = []
        wait(self._at_work, LOOK_S, FIRST_COMPLETED)
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
    """The error of a worker that was killed, or of a cluster that is gone."""
    return StereocalError(
        f"A worker ended before its task was done ({type(error).__name__}): if memory is short, "
        "use fewer workers, then start again."
    )
