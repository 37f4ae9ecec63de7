"""Where runs are computed: threads, processes, or a Dask cluster, all as one kind of executor."""

from __future__ import annotations

import multiprocessing
import os
import signal
from collections.abc import Iterator
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any

from stereocal.errors import StereocalError


@contextmanager
def engine(workers: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """An executor for `evaluation.evaluate`.

    Args:
        workers: so many processes; None for threads, which the compiled searches do not block.
        scheduler: address of a Dask scheduler, such as tcp://host:8786; its workers are used.

    Raises:
        StereocalError: both are given, or the cluster cannot be reached.
    """
    if workers is not None and scheduler is not None:
        raise StereocalError("Give either a number of workers or a scheduler, not both.")
    if workers is not None and workers < 1:
        raise StereocalError(f"The number of workers is {workers}: it must be at least 1.")
    if scheduler is not None:
        with _cluster(scheduler) as cluster:
            yield cluster
    elif workers is not None:
        with _processes(workers) as processes:
            yield processes
    else:
        threads = ThreadPoolExecutor(os.cpu_count() or 1)
        try:
            yield threads
        finally:  # after an error or Ctrl-C nobody waits for what they are at
            threads.shutdown(wait=False, cancel_futures=True)


@contextmanager
def _processes(workers: int) -> Iterator[Executor]:
    others = set(multiprocessing.active_children())
    processes = ProcessPoolExecutor(workers, mp_context=_Spawn())
    try:
        yield processes
    finally:
        try:
            # The pieces at work are finished: a process that is ended while it answers leaves half
            # an answer, for whose rest the pool waits for ever.
            processes.shutdown(cancel_futures=True)
        except KeyboardInterrupt:  # a second time
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise


class _Process(SpawnProcess):
    """Ctrl-C at a terminal reaches all processes: this one leaves it to the one that began it."""

    def start(self) -> None:
        if os.name == "nt":
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()  # it inherits what is blocked
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Spawn(SpawnContext):
    """Never fork: the server and NumPy run threads, whose locks a fork would copy."""

    Process = _Process


@contextmanager
def _cluster(address: str) -> Iterator[Executor]:
    try:
        import distributed
    except ImportError as error:
        raise StereocalError(
            "A scheduler needs Dask: pip install 'stereocal[cluster]' (or distributed)."
        ) from error
    connect: Any = distributed.Client
    try:
        client = connect(address, timeout="10s")
    except (OSError, TimeoutError, ValueError) as error:
        raise StereocalError(f"The scheduler at {address} cannot be reached ({error}).") from error
    with client:
        yield client.get_executor()
