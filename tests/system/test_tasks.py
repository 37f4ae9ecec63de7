"""One loop for all long work: in order, few tasks at once, jobs of one pool in turn."""

import operator
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import suppress

import pytest

from stereocal.system.executors import engine
from stereocal.system.tasks import SPARE, StoppedError, Task, run_tasks
from tests.refused import refused


def squares(count: int, taken: list[int] | None = None) -> Iterator[Task[int]]:
    for number in range(count):
        if taken is not None:
            taken.append(number)
        yield Task(pow, (number, 2), key=f"{number}")


class ByHand(Executor):
    """Two workers who end a task when the test says so."""

    _max_workers = 2

    def __init__(self) -> None:
        self.waiting: list[tuple[Future[object], Callable[[], object]]] = []

    def submit(self, function, /, *arguments, **named):  # type: ignore[no-untyped-def]
        future: Future[object] = Future()
        self.waiting.append((future, lambda: function(*arguments, **named)))
        return future

    def end(self, which: int) -> None:
        future, call = self.waiting.pop(which)
        try:
            future.set_result(call())
        except ArithmeticError as error:
            future.set_exception(error)


class Last(ByHand):
    """Ends the last task first, as soon as it has as many as it is given."""

    def submit(self, function, /, *arguments, **named):  # type: ignore[no-untyped-def]
        future = super().submit(function, *arguments, **named)  # type: ignore[no-untyped-call]
        if len(self.waiting) == self._max_workers + SPARE:
            while self.waiting:
                self.end(-1)
        return future


@pytest.mark.parametrize("make", [Last, lambda: ThreadPoolExecutor(3), lambda: None])
def test_results_come_in_the_order_of_the_tasks(make: Callable[[], Executor | None]) -> None:
    steps: list[tuple[int, int]] = []
    found = list(run_tasks(squares(99), make(), 99, lambda *both: steps.append(both)))
    assert [value for _, value in found] == [number**2 for number in range(99)]
    assert [task.key for task, _ in found] == [f"{number}" for number in range(99)]
    assert steps == [(done, 99) for done in range(1, 100)]


class Kept(dict[str, int]):
    def keep(self, key: str, result: int) -> None:
        self[key] = result


def test_what_was_kept_is_not_computed_again() -> None:
    earlier, steps = Kept({"3": -3, "0": 0}), list[int]()
    with ThreadPoolExecutor(2) as threads:
        found = list(run_tasks(squares(6), threads, 6, lambda done, _: steps.append(done), earlier))
    assert [value for _, value in found] == [0, 1, 4, -3, 16, 25]
    assert earlier == {"0": 0, "1": 1, "2": 4, "3": -3, "4": 16, "5": 25}
    assert steps == [1, 2, 3, 4, 5, 6]


def test_an_error_comes_in_its_turn_and_what_has_ended_is_kept() -> None:
    """Which of several errors is reported does not depend on chance."""
    earlier = Kept()
    tasks = [Task(operator.floordiv, (6, number), key=f"{number}") for number in (3, 0, 2)]
    found = run_tasks(tasks, Last(), 3, earlier=earlier)
    assert next(found)[1] == 2
    with pytest.raises(ZeroDivisionError):
        next(found)
    assert earlier == {"3": 2, "2": 3}


def test_a_job_that_begins_waits_for_few_tasks_of_another() -> None:
    """Counted, not timed: behind somebody's 10,000 tasks it waits for those handed in, not more."""
    order: list[str] = []
    gate, stop = threading.Event(), threading.Event()

    def job(name: str, count: int) -> None:
        tasks = (Task(order.append, (name,)) for _ in range(count))
        with suppress(StoppedError):
            list(run_tasks(tasks, pool, count, cancel))

    def cancel(_done: int, _total: int) -> None:
        if stop.is_set():
            raise StoppedError

    with ThreadPoolExecutor(1) as pool:
        pool.submit(gate.wait)
        threads = [threading.Thread(target=job, args=job_) for job_ in (("a", 10_000), ("b", 2))]
        for number, thread in enumerate(threads):
            thread.start()
            while pool._work_queue.qsize() < (number + 1) * (1 + SPARE):
                time.sleep(0.001)
        gate.set()
        threads[1].join()
        stop.set()
        threads[0].join()
    assert order[: 2 * (1 + SPARE)] == ["a"] * (1 + SPARE) + ["b"] * 2


def stop_the_process() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_worker_that_is_killed_is_an_error_in_words() -> None:
    tasks = (Task(stop_the_process, ()) for _ in range(3))
    with refused("worker"), engine(1) as executor:
        list(run_tasks(tasks, executor, 3))


SERVER = """
import threading, time
from concurrent.futures import ThreadPoolExecutor
from stereocal.system.tasks import EndingError, Task, run_tasks

begun = threading.Event()

def job():
    tasks = (Task(time.sleep, (0.01,)) for _ in range(100_000))
    try:
        list(run_tasks(tasks, ThreadPoolExecutor(2), 100_000, lambda *_: begun.set()))
    except EndingError:
        print("ending", flush=True)

threading.Thread(target=job, daemon=True).start()
begun.wait()
"""


def test_a_server_that_ends_does_not_wait_for_its_jobs() -> None:
    """They are neither finished nor failed then: they were interrupted."""
    ended = subprocess.run(
        [sys.executable, "-c", SERVER], capture_output=True, text=True, timeout=100, check=True
    )
    assert ended.stderr == ""
    assert ended.stdout in ("ending\n", "")  # the thread may not live to say it


class EndsLate(Future[object]):
    """Has ended, but says so only when asked again, as one that ends between two looks."""

    looks = 0

    def done(self) -> bool:
        self.looks += 1
        return self.looks > 1


class Late(Executor):
    _max_workers = 1

    def submit(self, function, /, *arguments, **named):  # type: ignore[no-untyped-def]
        future = EndsLate()
        future.set_result(function(*arguments, **named))
        return future


def test_what_ends_between_two_looks_is_counted_and_kept() -> None:
    counted: list[tuple[int, int]] = []
    kept = Kept()
    found = run_tasks(squares(5), Late(), 5, lambda *now: counted.append(now), kept)
    assert [result for _, result in found] == [0, 1, 4, 9, 16]
    assert counted[-1] == (5, 5)
    assert kept == {f"{number}": number**2 for number in range(5)}
