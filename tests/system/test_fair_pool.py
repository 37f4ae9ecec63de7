"""One pool for all: owners take turns, and each has a proper executor."""

from __future__ import annotations

import gc
import threading
import time
import weakref
from concurrent.futures import CancelledError, as_completed

import pytest

from stereocal.system.fair_pool import FairPool


class Gate:
    """A pool of one worker that is held until everything has been handed in."""

    def __init__(self, workers: int = 1) -> None:
        self.pool = FairPool(workers)
        self._open = threading.Event()
        self._held = [self.pool.of("gate").submit(self._hold) for _ in range(workers)]
        while not all(future.running() for future in self._held):
            time.sleep(0.001)

    def _hold(self) -> bool:
        return self._open.wait(20)

    def open(self) -> None:
        self._open.set()
        for future in self._held:
            assert future.result(20)


def test_owners_take_turns() -> None:
    """100 runs of one person are done after 200 tasks, behind another's 10,000."""
    gate = Gate()
    done: list[str] = []
    long = [gate.pool.of("long").submit(done.append, "long") for _ in range(10_000)]
    short = [gate.pool.of("short").submit(done.append, "short") for _ in range(100)]
    gate.open()
    for future in short:
        future.result(20)
    assert done[:200] == ["long", "short"] * 100
    for future in long:
        future.result(20)
    assert done[200:] == ["long"] * 9900


def test_each_owner_has_its_own_order_and_three_take_thirds() -> None:
    gate = Gate()
    done: list[tuple[str, int]] = []
    futures = [
        gate.pool.of(owner).submit(done.append, (owner, number))
        for owner in "abc"
        for number in range(3)
    ]
    gate.open()
    for future in futures:
        future.result(20)
    assert done == [(owner, number) for number in range(3) for owner in "abc"]


def test_a_newcomer_waits_for_one_task_of_each() -> None:
    """Somebody who comes while others have queues is not put behind these."""
    gate = Gate()
    done: list[str] = []
    for owner in "ab":
        for _ in range(50):
            gate.pool.of(owner).submit(done.append, owner)
    gate.open()
    gate.pool.of("new").submit(done.append, "new").result(20)
    gate.pool.shutdown()
    at = done.index("new")
    assert at <= 101
    assert len(done) == 101


def test_what_is_cancelled_is_no_turn_and_is_never_run() -> None:
    gate = Gate()
    done: list[str] = []
    first = [gate.pool.of("a").submit(done.append, f"a{i}") for i in range(6)]
    second = [gate.pool.of("b").submit(done.append, f"b{i}") for i in range(2)]
    for future in first[:4]:
        assert future.cancel()
    gate.open()
    for future in (*first[4:], *second):
        future.result(20)
    assert done == ["a4", "b0", "a5", "b1"]
    with pytest.raises(CancelledError):
        first[0].result(20)


def test_an_error_is_the_futures_and_the_worker_goes_on() -> None:
    pool = FairPool(1)
    failing = pool.of("a").submit(lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        failing.result(20)
    assert pool.of("a").submit(pow, 2, 5).result(20) == 32
    pool.shutdown()


def test_no_more_tasks_at_once_than_workers() -> None:
    pool, lock = FairPool(3), threading.Lock()
    now, most = 0, 0
    together = threading.Barrier(3)

    def work() -> None:
        nonlocal now, most
        with lock:
            now += 1
            most = max(most, now)
        together.wait(20)  # 30 tasks, three at a time: it breaks with fewer workers
        with lock:
            now -= 1

    futures = [pool.of(str(number % 7)).submit(work) for number in range(30)]
    for future in as_completed(futures, 20):
        future.result()
    assert most == 3
    pool.shutdown()


def test_an_owners_executor_is_one_of_concurrent_futures() -> None:
    pool = FairPool(2)
    with pool.of("a") as executor:
        assert list(executor.map(pow, range(5), [2] * 5)) == [0, 1, 4, 9, 16]
    with pytest.raises(RuntimeError):
        executor.submit(pow, 2, 2)
    assert pool.of("a").submit(pow, 2, 2).result(20) == 4
    pool.shutdown()
    with pytest.raises(RuntimeError):
        pool.of("a").submit(pow, 2, 2)


@pytest.mark.parametrize("of_pool", [True, False])
def test_shutdown_can_drop_what_has_not_begun(of_pool: bool) -> None:
    gate = Gate()
    executor = gate.pool.of("a")
    futures = [executor.submit(pow, 2, 2) for _ in range(5)]
    (gate.pool if of_pool else executor).shutdown(wait=False, cancel_futures=True)
    gate.open()
    assert all(future.cancelled() for future in futures)
    gate.pool.shutdown()


def test_shutdown_finishes_what_waits() -> None:
    pool = FairPool(2)
    futures = [pool.of(str(i)).submit(pow, i, 2) for i in range(20)]
    pool.shutdown()
    assert [future.result(0) for future in futures] == [i * i for i in range(20)]


def test_arguments_are_let_go_of_when_a_task_is_done() -> None:
    class Large:
        pass

    pool, large = FairPool(1), Large()
    gone = weakref.ref(large)
    pool.of("a").submit(id, large).result(20)
    pool.of("a").submit(id, 0).result(20)
    del large
    gc.collect()
    assert gone() is None
    pool.shutdown()
