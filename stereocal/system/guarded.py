"""Untrusted files, decoded in a process of its own first, where people share a server.

    guard = Guard({"photograph": read_photograph})
    guard.check("photograph", path, "left07.png")

Photographs, Parquet and HDF5 are decoded by native code, which a malformed file can crash, hang, or
make to take all memory. A file that is merely damaged passes: its reader says what is wrong.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import tempfile
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from pathlib import Path

from pebble import ProcessPool

from stereocal.errors import StereocalError
from stereocal.system.limits import MB, Limits

Reader = Callable[[Path], object]
"""A function of a module, which the child imports by its name."""
LEAST_SECONDS = 10.0
SECONDS_PER_MB = 0.1
"""A 16-bit PNG of 200 megapixels may take seconds; a busy server is slower still."""
LOOK_S = 0.2
"""How often a pool is asked whether it still works."""
SPARE = 1_000_000_000
BYTES_PER_PIXEL = 16
"""Four channels of 16 bits, three of them copied to be weighed, and the grey image."""


class Guard:
    """A pool of processes that try files, started when first needed.

    Args:
        readers: what reads a file of each kind.
        children: how many files are tried at the same time; with 0, none is tried.
        least_seconds: what a small file may take.
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
        """Try a file, which messages call `name`.

        Raises:
            StereocalError: it crashes its decoder, takes too long or too much memory, or is gone.
        """
        if not self._children:
            return
        try:
            seconds = self._least_seconds + SECONDS_PER_MB * path.stat().st_size / MB
        except OSError as error:
            raise StereocalError(f"{name} cannot be read: {error.strerror or error}.") from error
        try:
            reason = self._tried(kind, path, seconds)
        except (BrokenProcessPool, RuntimeError) as error:
            raise StereocalError("The server cannot start the process that tries files.") from error
        if reason:
            raise StereocalError(
                f"{name}: the file {reason}, and is not read; save it anew, by another program "
                "if need be."
            )

    def check_content(self, kind: str, content: bytes, name: str, suffix: str = "") -> None:
        """As `check`, of a file's content."""
        if not self._children:
            return
        try:
            with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
                path = Path(folder) / f"file{suffix}"
                path.write_bytes(content)
                self.check(kind, path, name)
        except OSError as error:
            raise StereocalError(f"{name} cannot be stored: {error.strerror or error}.") from error

    def refused(self, kind: str, files: Mapping[str, Path]) -> dict[str, StereocalError]:
        """Try many files; those that do not pass, with the reason."""

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
        """End the processes; the next file starts others."""
        with self._lock:
            if self._pool is not None:
                self._pool.stop()  # type: ignore[no-untyped-call]
                self._pool.join()
            self._pool = None

    def _tried(self, kind: str, path: Path, seconds: float, again: bool = True) -> str:
        """Why a file does not pass; empty if it does."""
        with self._lock:
            if self._pool is None or not self._pool.active:
                self._pool = self._started()
            pool = self._pool
            future = pool.schedule(
                _read, (self._readers[kind], path.resolve(), seconds), timeout=seconds
            )
        try:
            # A file that comes while a pool breaks is forgotten by Pebble: nobody would end it.
            while not wait([future], LOOK_S).done:
                if not pool.active:
                    raise BrokenProcessPool
            future.result()
        except TimeoutError:
            return f"takes too long to be decoded, more than {seconds:.0f} s"
        except MemoryError:
            return "needs too much memory to be decoded"
        except BrokenProcessPool:  # all children were killed, by the system for instance
            if again:
                return self._tried(kind, path, seconds, again=False)
            raise
        except Exception:  # it has ended, or something that must not happen in the server
            return "makes its decoder fail"
        return ""

    def _started(self) -> ProcessPool:
        room = SPARE + int(min(BYTES_PER_PIXEL * Limits.from_environment().megapixels * MB, 1e15))
        return ProcessPool(
            max_workers=self._children,
            initializer=_prepare,
            initargs=(tuple(self._readers.values()), room),
            context=multiprocessing.get_context("spawn"),
        )


def _prepare(_: tuple[Reader, ...], room: int) -> None:
    """In the child: allow so many bytes more than its imports take, where the system counts them.

    Args:
        _: the readers, whose modules are imported with this argument.
    """
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # a decoder that hangs takes no other
    os.environ["ARROW_DEFAULT_MEMORY_POOL"] = "system"  # others set aside more addresses
    for stream in (1, 2):  # what decoders print
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)
    with suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + room, used + room))


def _read(read: Reader, path: Path, seconds: float) -> None:
    """In the child: try a file."""
    if hasattr(signal, "alarm"):  # the server that would end it may have been killed
        signal.alarm(int(seconds) + 5)
    try:
        read(path)
    except StereocalError:
        return
    finally:
        if hasattr(signal, "alarm"):
            signal.alarm(0)
