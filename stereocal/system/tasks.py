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
"""Longest time between two calls of `Progress`, which may cancel the work."""


@dataclass(frozen=True)
class Task(Generic[T]):
    """A function call; function and arguments can be pickled."""

    function: Callable[..., T]
    arguments: tuple[Any, ...]
    size: int = 1
    """Amount of progress: runs, rows."""
    key: str = ""
    """For `Earlier`: identifies everything that the result depends on."""


class Earlier(Protocol[T]):
    """Results of an earlier run that was not finished, by the keys of their tasks."""

    def get(self, key: str, /) -> T | None:
        """The result; None if it is not stored or cannot be read."""

    def keep(self, key: str, result: T, /) -> None:
        """Store a result."""


class StoppedError(Exception):
    """The work was cancelled: `Progress` raises it."""


class EndingError(Exception):
    """The program is shutting down and takes no more tasks."""


def run_tasks(
    tasks: Iterable[Task[T]],
    executor: Executor | None,
    total: int,
    progress: Progress | None = None,
    earlier: Earlier[T] | None = None,
    ahead: int = AHEAD,
) -> Generator[tuple[Task[T], T], None, None]:
    """Yield each task with its result, in the order of the tasks.

    Iterate inside `contextlib.closing`, which cancels tasks that have not begun.

    Args:
        tasks: consumed one by one, as workers become free.
        executor: None: the calling thread.
        total: sum of the sizes of all tasks, for `progress`, which is called as tasks end, at least
            every `POLL_S`; what it raises ends the work.
        earlier: tasks whose results it has are not computed; gets the results of all.
        ahead: largest number of tasks begun but not yielded, which limits memory.

    Raises:
        EndingError: the program is shutting down.
        StereocalError: a worker process or the cluster was lost.
        Also any exception of a task, when its turn comes.
    """
    waiting, done, report = iter(tasks), 0, progress or (lambda _done, _total: None)
    most = 1 if executor is None else tasks_at_once(executor) + SPARE
    begun: deque[tuple[Task[T], Future[T]]] = deque()
    at_work: dict[Future[T], Task[T]] = {}
    try:
        while True:
            while len(at_work) < most and len(begun) < ahead:
                if (task := next(waiting, None)) is None:
                    break
                future = _begun(task, executor, earlier)
                begun.append((task, future))
                at_work[future] = task
            if not begun:
                return
            wait(at_work, POLL_S, FIRST_COMPLETED)
            ended = [future for future in at_work if future.done()]
            for future in ended:
                done += _kept(at_work.pop(future), future, earlier)
                report(done, total)
            if not ended:
                report(done, total)
            while begun and begun[0][1] not in at_work:  # counted and kept
                task, future = begun.popleft()
                yield task, _result(future)
    finally:
        for _, future in begun:
            future.cancel()


def _begun(task: Task[T], executor: Executor | None, earlier: Earlier[T] | None) -> Future[T]:
    if earlier is not None and (known := earlier.get(task.key)) is not None:
        return _ended(known)
    if executor is None:
        return _ended(task.function(*task.arguments))
    try:
        return executor.submit(task.function, *task.arguments)
    except BrokenExecutor as error:
        raise _lost(error) from error
    except RuntimeError as error:
        raise EndingError from error


def _kept(task: Task[T], future: Future[T], earlier: Earlier[T] | None) -> int:
    """Keep the result of a task that has ended: how much is done by it; 0 if it failed."""
    if future.cancelled() or future.exception() is not None:
        return 0
    if earlier is not None:
        earlier.keep(task.key, future.result())
    return task.size


def _ended(result: T) -> Future[T]:
    future: Future[T] = Future()
    future.set_result(result)
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
