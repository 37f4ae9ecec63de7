"""Executors for tasks: threads, processes, or a Dask cluster."""

import multiprocessing
import os
import re
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, ProcessPoolExecutor, ThreadPoolExecutor
from contextlib import contextmanager
from multiprocessing.context import SpawnContext, SpawnProcess
from typing import Any, ParamSpec

from stereocal.errors import StereocalError
from stereocal.system.child_process import end_with_parent
from stereocal.version import __version__

P = ParamSpec("P")
SCHEDULER = "STEREOCAL_SCHEDULER"
"""Environment variable with the address of the cluster for a server's jobs."""
LONGEST_TO_CONNECT = "10s"


@contextmanager
def engine(workers: int | None = None, scheduler: str | None = None) -> Iterator[Executor]:
    """An executor for `tasks.run_tasks`, until the context ends.

    Args:
        workers: number of processes; None: threads (compiled code and OpenCV release the GIL).
        scheduler: address of a Dask scheduler, such as tcp://host:8786, whose workers to use.
    """
    if workers is not None and scheduler is not None:
        raise StereocalError("State either a number of workers or a scheduler, not both.")
    if workers is not None and workers < 1:
        raise StereocalError(f"The number of workers is {workers}: it must be at least 1.")
    if scheduler is not None:
        with _client(scheduler) as client:
            # pure=False: Dask does not hash the arguments to find equal calls.
            remote = client.get_executor(pure=False)
            remote._max_workers = sum(client.ncores().values())
            yield remote
        return
    if workers is None:
        threads = ThreadPoolExecutor(os.cpu_count() or 1)
        try:
            yield threads
        finally:  # after an error or Ctrl-C do not wait for running tasks
            threads.shutdown(wait=False, cancel_futures=True)
        return
    others = set(multiprocessing.active_children())
    processes = ProcessPoolExecutor(workers, _Spawn(), end_with_parent)
    try:
        yield processes
    finally:
        try:
            # Running tasks are finished: if a process is terminated while it sends a result, the
            # pool waits for the rest for ever.
            processes.shutdown(cancel_futures=True)
        except KeyboardInterrupt:  # a second time
            for process in set(multiprocessing.active_children()) - others:
                process.terminate()
            raise


def in_background(
    function: Callable[P, object], /, *arguments: P.args, **named: P.kwargs
) -> threading.Thread:
    """Call in a thread of its own, for what waits for tasks or for the clock.

    On the executor of its tasks it could take the place that they wait for. A program that ends
    does not wait for it, as it would for each thread of a `ThreadPoolExecutor`.
    """
    thread = threading.Thread(target=function, args=arguments, kwargs=named, daemon=True)
    thread.start()
    return thread


class _Process(SpawnProcess):
    """A process that ignores Ctrl-C, which the terminal sends to all processes."""

    def start(self) -> None:
        if os.name == "nt":
            super().start()
            return
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            super().start()  # inherits the signal mask
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


class _Spawn(SpawnContext):
    """Spawn, because a fork would copy the locks of the server's and NumPy's threads."""

    Process = _Process


@contextmanager
def _client(address: str) -> Iterator[Any]:
    """A client of a Dask scheduler whose workers have this version of stereocal."""
    try:
        import dask
        import distributed
    except ImportError as error:
        raise StereocalError(
            "A scheduler needs Dask: pip install 'stereocal[cluster]' (or distributed)."
        ) from error
    dask.config.set({"distributed.admin.large-graph-warning-threshold": "1GB"})  # photographs
    connect: Any = distributed.Client
    try:
        client = connect(address, timeout=LONGEST_TO_CONNECT)
    except (OSError, TimeoutError, ValueError) as error:
        raise StereocalError(f"The scheduler at {address} cannot be reached ({error}).") from error
    with client:
        try:
            versions = set(client.run(_version).values())
        except Exception as error:  # any error raised on a worker without stereocal
            raise StereocalError(
                f"The workers of {address} cannot import stereocal ({error}): install it on them."
            ) from error
        if versions != {__version__}:
            there = ", ".join(sorted(versions)) or "no workers"
            raise StereocalError(
                f"The cluster at {address} has {there}, and this is stereocal {__version__}: start "
                "workers with the same version."
            )
        yield client


def is_cluster(executor: Executor) -> bool:
    """Whether an executor is that of a cluster, whose workers may have no access to our disk."""
    return type(executor).__module__.partition(".")[0] == "distributed"


def tasks_at_once(executor: Executor) -> int:
    """How many tasks an executor computes at the same time."""
    # Thread and process pools have no public name for it.
    return int(getattr(executor, "_max_workers", None) or os.cpu_count() or 1)


def scheduler_of(environment: Mapping[str, str]) -> str | None:
    """The address in STEREOCAL_SCHEDULER; None if it is not set."""
    address = environment.get(SCHEDULER, "").strip()
    if address and not re.fullmatch(r"(tcp|tls|ws|wss)://\S+:\d+", address):
        raise StereocalError(
            f'{SCHEDULER} is "{address[:80]}": it must be the address of a Dask scheduler, such as '
            "tcp://host:8786."
        )
    return address or None


def _version() -> str:
    return __version__
