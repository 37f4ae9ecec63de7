"""One pool of threads for many owners, who take turns: a long queue of one keeps nobody waiting.

    pool = FairPool(4)
    evaluate(datasets, settings, pool.of("somebody"))

A task that has begun is not interrupted: a newcomer waits for one task of another at the longest,
where there is a worker for each owner, and else for one task of each.
"""

from __future__ import annotations

import threading
from collections import OrderedDict, deque
from collections.abc import Callable
from concurrent import futures
from concurrent.futures import Executor, Future
from typing import Any, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


class FairPool:
    """So many threads, which take the next task of each owner in turn.

    The threads begin with the first task, and do not keep the program from ending.
    """

    def __init__(self, workers: int) -> None:
        self.workers = workers
        self._threads: list[threading.Thread] = []
        self._waiting: OrderedDict[str, deque[_Task]] = OrderedDict()
        """Owners with tasks; whose turn it is stands first."""
        self._ended = False
        self._changed = threading.Condition()

    def of(self, owner: str) -> Executor:
        """What an owner submits to. Executors of one name are one owner."""
        return _Share(self, owner)

    def shutdown(self, wait: bool = True, cancel_futures: bool = False) -> None:
        """Take no more tasks; the threads end when nothing waits.

        Args:
            wait: come back only then.
            cancel_futures: drop what has not begun.
        """
        with self._changed:
            self._ended = True
            waiting = [task for tasks in self._waiting.values() for task in tasks]
            if cancel_futures:
                self._waiting.clear()
            self._changed.notify_all()
        if cancel_futures:
            for task in waiting:
                task.future.cancel()
        if wait:
            for thread in self._threads:
                thread.join()

    def _add(self, owner: str, task: _Task) -> None:
        with self._changed:
            if self._ended:
                raise RuntimeError("The pool has been shut down.")
            self._waiting.setdefault(owner, deque()).append(task)
            if len(self._threads) < self.workers:
                name = f"worker-{len(self._threads)}"
                thread = threading.Thread(target=self._work, name=name, daemon=True)
                self._threads.append(thread)
                thread.start()
            self._changed.notify()

    def _work(self) -> None:
        while (task := self._next()) is not None:
            task.run()
            del task  # its arguments are not held while nothing is to do

    def _next(self) -> _Task | None:
        """The task whose turn it is, once there is one; None when the pool has ended."""
        with self._changed:
            while True:
                while self._waiting:
                    owner, tasks = self._waiting.popitem(last=False)
                    task = tasks.popleft()
                    begins = task.future.set_running_or_notify_cancel()
                    if tasks:
                        self._waiting[owner] = tasks
                        if not begins:  # one that was cancelled is no turn
                            self._waiting.move_to_end(owner, last=False)
                    if begins:
                        return task
                if self._ended:
                    return None
                self._changed.wait()


class _Task:
    def __init__(self, future: Future[Any], call: Callable[[], Any]) -> None:
        self.future = future
        self.call = call

    def run(self) -> None:
        try:
            result = self.call()
        except BaseException as error:
            self.future.set_exception(error)
        else:
            self.future.set_result(result)


class _Share(Executor):
    """An owner's view of the pool."""

    def __init__(self, pool: FairPool, owner: str) -> None:
        self._pool = pool
        self._owner = owner
        self._futures: set[Future[Any]] = set()
        self._ended = False
        self._lock = threading.Lock()

    def submit(
        self, function: Callable[P, T], /, *arguments: P.args, **named: P.kwargs
    ) -> Future[T]:
        """Hand in a task."""
        future: Future[T] = Future()
        with self._lock:
            if self._ended:
                raise RuntimeError("This executor has been shut down.")
            self._futures.add(future)
        future.add_done_callback(self._forget)
        try:
            self._pool._add(self._owner, _Task(future, lambda: function(*arguments, **named)))
        except RuntimeError:
            self._forget(future)
            raise
        return future

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = False) -> None:
        """Take no more tasks of this owner here; the pool goes on."""
        with self._lock:
            self._ended = True
            left = list(self._futures)
        if cancel_futures:
            for future in left:
                future.cancel()
        if wait:
            futures.wait(left)

    def _forget(self, future: Future[Any]) -> None:
        with self._lock:
            self._futures.discard(future)
