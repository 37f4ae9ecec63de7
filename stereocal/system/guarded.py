"""Read untrusted files with native code in a separate process.

    guard = Guard([read_times])
    times = guard.read(read_times, path, "left.mp4")

A malformed HDF5 file or video can crash its decoder, hang it or make it exhaust memory.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stereocal.errors import StereocalError, disk_errors
from stereocal.system.child_process import end_with_parent
from stereocal.system.limits import MB, Limits

if TYPE_CHECKING:
    from pebble import ProcessPool

Reader = Callable[..., object]
"""A module-level function of a path and perhaps more, which the child imports by its name."""
LEAST_SECONDS = 10.0
SECONDS_PER_MB = 0.1
"""A 16-bit PNG of 200 megapixels may take seconds, longer on a busy server."""
POLL_S = 0.2
"""Interval in which it is checked whether the pool still works."""
SPARE = 1_000_000_000
BYTES_PER_PIXEL = 16
"""Four channels of 16 bits, a copy of three of them, and the grey image."""


class Guard:
    """A pool of processes that read files, started when first needed.

    Args:
        readers: the functions that `read` is called with.
        children: number of processes.
        least_seconds: time limit for a small file.
    """

    def __init__(
        self, readers: Sequence[Reader], children: int = 2, least_seconds: float = LEAST_SECONDS
    ) -> None:
        self._readers = tuple(readers)
        self._children = children
        self._least_seconds = least_seconds
        self._lock = threading.Lock()
        self._pool: ProcessPool | None = None

    def read(self, read: Reader, path: Path, name: str, *arguments: Any) -> Any:
        """What a reader returns for a file, called `name` in messages.

        Args:
            arguments: of the reader, after the path.
        """
        return self.read_all(read, [(path, name, *arguments)])[0]

    def read_all(
        self,
        read: Reader,
        files: Sequence[tuple[Path, str, *tuple[Any, ...]]],
        look: Callable[[], object] = lambda: None,
    ) -> list[Any]:
        """What a reader returns for each of a few files, read at the same time.

        Args:
            files: each with what `read` takes after the reader.
            look: called while they are read, every `POLL_S`; what it raises ends the reading.
        """
        calls = []
        for path, name, *arguments in files:
            with disk_errors(f"{name} cannot be read"):
                seconds = self._least_seconds + SECONDS_PER_MB * path.stat().st_size / MB
            calls.append((name, seconds, (read, path.resolve(), seconds, arguments)))
        try:
            with suppress(BrokenProcessPool):  # all children were killed, for example by the system
                return self._tried(calls, look)
            return self._tried(calls, look)
        except (BrokenProcessPool, RuntimeError) as error:
            raise StereocalError(
                "The server cannot start its process for reading files."
            ) from error

    def close(self) -> None:
        """Stop the processes; the next check starts new ones."""
        with self._lock:
            if self._pool is not None:
                self._pool.stop()  # type: ignore[no-untyped-call]
                self._pool.join()
            self._pool = None

    def _tried(
        self, calls: Sequence[tuple[str, float, tuple[Any, ...]]], look: Callable[[], object]
    ) -> list[Any]:
        with self._lock:
            if self._pool is None or not self._pool.active:
                self._pool = self._started()
            pool = self._pool
            futures: list[Future[Any]] = [
                pool.schedule(_read, call, timeout=seconds) for _, seconds, call in calls
            ]
        try:
            # Pebble forgets a file that is scheduled while a pool breaks: it would never end.
            while wait(futures, POLL_S).not_done:
                look()
                if not pool.active:
                    raise BrokenProcessPool
        finally:
            for future in futures:
                future.cancel()
        every = zip(futures, calls, strict=True)
        return [_result(future, name, seconds) for future, (name, seconds, _) in every]

    def _started(self) -> ProcessPool:
        from pebble import ProcessPool  # where nothing is decoded apart, nothing starts processes

        memory = SPARE + int(min(BYTES_PER_PIXEL * Limits.from_environment().megapixels * MB, 1e15))
        return ProcessPool(
            max_workers=self._children,
            initializer=_prepare,
            initargs=(self._readers, memory),
            context=multiprocessing.get_context("spawn"),
        )


def read_apart(read: Reader, content: bytes, name: str, *arguments: Any) -> Any:
    """What a reader returns for a file's content, read in a process of its own.

    Args:
        arguments: of the reader, after the path.
    """
    guard = Guard([read], children=1)
    try:
        with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
            path = Path(folder) / "file"
            with disk_errors(f"{name} cannot be stored"):
                path.write_bytes(content)
            return guard.read(read, path, name, *arguments)
    finally:
        guard.close()


def _result(future: Future[Any], name: str, seconds: float) -> Any:
    try:
        return future.result()
    except (StereocalError, BrokenProcessPool):
        raise
    except TimeoutError:
        reason = f"takes too long to be decoded, more than {seconds:.0f} s"
    except MemoryError:
        reason = "needs too much memory to be decoded"
    except Exception:  # the child died, or the decoder raised an unexpected error
        reason = "makes its decoder fail"
    raise StereocalError(
        f"{name}: the file {reason} and was not read; save it again, if necessary with another "
        "program."
    )


def _prepare(_: tuple[Reader, ...], memory: int) -> None:
    """In the child: limit its memory to that of its imports plus `memory` bytes, on Linux.

    Args:
        _: the readers; unpickling this argument imports their modules.
    """
    end_with_parent()
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a hanging decoder runs no Python handler
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # others reserve more address space
    for stream in (1, 2):  # silence the decoders
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))


def _read(read: Reader, path: Path, seconds: float, arguments: Sequence[Any]) -> Any:
    """In the child: what a reader returns."""
    if hasattr(signal, "alarm"):  # in case the server, which enforces the timeout, was killed
        signal.alarm(int(seconds) + 5)
    try:
        return read(path, *arguments)
    finally:
        if hasattr(signal, "alarm"):
            signal.alarm(0)
