"""On a shared server, decode untrusted files in a separate process first.

    guard = Guard({"photograph": read_photograph})
    guard.check("photograph", path, "left07.png")

Photographs, Parquet and HDF5 are decoded by native code, which a malformed file can crash, hang or
make exhaust memory. A file that is merely damaged passes: its reader reports what is wrong.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stereocal.errors import StereocalError, disk_errors
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
    """A pool of processes that try to decode files, started when first needed.

    Args:
        readers: the reader of each kind of file.
        children: number of processes; 0: no checks.
        least_seconds: time limit for a small file.
    """

    def __init__(
        self,
        readers: Mapping[str, Reader],
        children: int = 2,
        least_seconds: float = LEAST_SECONDS,
    ) -> None:
        self._readers = readers
        self._children = children
        self._least_seconds = least_seconds
        self._lock = threading.Lock()
        self._pool: ProcessPool | None = None

    def check(self, kind: str, path: Path, name: str) -> None:
        """Try to decode a file, called `name` in messages."""
        if self._children:
            self._run(kind, path, name)

    def read(self, kind: str, path: Path, name: str, *arguments: Any) -> Any:
        """What the reader returns for a file, for decoders that must not run in this process.

        Args:
            arguments: of the reader, after the path.
        """
        found = self._run(kind, path, name, arguments)
        if isinstance(found, StereocalError):
            raise found
        return found

    def _run(
        self, kind: str, path: Path, name: str, arguments: tuple[Any, ...] | None = None
    ) -> Any:
        with disk_errors(f"{name} cannot be read"):
            seconds = self._least_seconds + SECONDS_PER_MB * path.stat().st_size / MB
        try:
            reason, found = self._tried(kind, path, seconds, arguments)
        except (BrokenProcessPool, RuntimeError) as error:
            raise StereocalError(
                "The server cannot start its process for checking files."
            ) from error
        if reason:
            raise StereocalError(
                f"{name}: the file {reason} and was not read; save it again, if necessary with "
                "another program."
            )
        return found

    def check_content(self, kind: str, content: bytes, name: str, suffix: str = "") -> None:
        """As `check`, for a file's content."""
        if self._children:
            with _stored(content, name, suffix) as path:
                self.check(kind, path, name)

    def refused(self, kind: str, files: Mapping[str, Path]) -> dict[str, StereocalError]:
        """Check many files; returns the errors of those that fail, by name."""

        def reason(item: tuple[str, Path]) -> StereocalError | None:
            try:
                self.check(kind, item[1], item[0])
            except StereocalError as error:
                return error
            return None

        with ThreadPoolExecutor(max(self._children, 1)) as threads:
            found = zip(files, threads.map(reason, files.items()), strict=True)
            return {name: error for name, error in found if error is not None}

    def close(self) -> None:
        """Stop the processes; the next check starts new ones."""
        with self._lock:
            if self._pool is not None:
                self._pool.stop()  # type: ignore[no-untyped-call]
                self._pool.join()
            self._pool = None

    def _tried(
        self,
        kind: str,
        path: Path,
        seconds: float,
        arguments: tuple[Any, ...] | None,
        again: bool = True,
    ) -> tuple[str, Any]:
        """Why a file fails, empty if it passes; and what its reader returns.

        Args:
            arguments: of the reader; None if what it returns is not wanted.
        """
        with self._lock:
            if self._pool is None or not self._pool.active:
                self._pool = self._started()
            pool = self._pool
            future = pool.schedule(
                _read, (self._readers[kind], path.resolve(), seconds, arguments), timeout=seconds
            )
        try:
            # Pebble forgets a file that is scheduled while a pool breaks: it would never end.
            while not wait([future], POLL_S).done:
                if not pool.active:
                    raise BrokenProcessPool
            return "", future.result()
        except TimeoutError:
            return f"takes too long to be decoded, more than {seconds:.0f} s", None
        except MemoryError:
            return "needs too much memory to be decoded", None
        except BrokenProcessPool:  # all children were killed, for example by the system
            if again:
                return self._tried(kind, path, seconds, arguments, again=False)
            raise
        except Exception:  # the child died, or the decoder raised an unexpected error
            return "makes its decoder fail", None

    def _started(self) -> ProcessPool:
        from pebble import ProcessPool  # where nothing is decoded apart, nothing starts processes

        memory = SPARE + int(min(BYTES_PER_PIXEL * Limits.from_environment().megapixels * MB, 1e15))
        return ProcessPool(
            max_workers=self._children,
            initializer=_prepare,
            initargs=(tuple(self._readers.values()), memory),
            context=multiprocessing.get_context("spawn"),
        )


def read_apart(read: Reader, content: bytes, name: str, *arguments: Any) -> Any:
    """What a reader returns for a file's content, read in a process of its own.

    Args:
        arguments: of the reader, after the path.
    """
    guard = Guard({"file": read}, children=1)
    try:
        with _stored(content, name) as path:
            return guard.read("file", path, name, *arguments)
    finally:
        guard.close()


def _prepare(_: tuple[Reader, ...], memory: int) -> None:
    """In the child: limit its memory to that of its imports plus `memory` bytes, on Linux.

    Args:
        _: the readers; unpickling this argument imports their modules.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a hanging decoder runs no Python handler
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # others reserve more address space
    for stream in (1, 2):  # silence the decoders
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + memory, used + memory))


@contextmanager
def _stored(content: bytes, name: str, suffix: str = "") -> Iterator[Path]:
    """A temporary file with this content."""
    with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
        path = Path(folder) / f"file{suffix}"
        with disk_errors(f"{name} cannot be stored"):
            path.write_bytes(content)
        yield path


def _read(read: Reader, path: Path, seconds: float, arguments: tuple[Any, ...] | None) -> Any:
    """In the child: try to read a file; returns its contents or the error, if wanted."""
    if hasattr(signal, "alarm"):  # in case the server, which enforces the timeout, was killed
        signal.alarm(int(seconds) + 5)
    try:
        found = read(path, *(arguments or ()))
        return None if arguments is None else found
    except StereocalError as error:
        return None if arguments is None else error
    finally:
        if hasattr(signal, "alarm"):
            signal.alarm(0)
