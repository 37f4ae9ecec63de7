"""Files of strangers, decoded in a process of its own first: what ends it does not end the server.

    server_guard().check("photograph", path, "left07.png")

Photographs, OpenCV's camera files and Parquet are decoded by native code, which a malformed file
can crash, hang, or make to take all memory. The server tries each file once in a child process with
limits; only what the child survives is decoded in the server itself. A file that is merely damaged
is survived: its reader says what is wrong with it, as ever.
"""

from __future__ import annotations

import atexit
import contextlib
import hashlib
import json
import os
import queue
import subprocess
import sys
import tempfile
import threading
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.system.guarded_child import FAILED, MEMORY, READY, SURVIVED

READERS = "stereocal.formats.guarded_readers"
CHILDREN = 2
"""So that a slow file of one session does not hold up the others."""
LEAST_SECONDS = 10.0
SECONDS_PER_MB = 0.1
"""A 16-bit PNG of 200 megapixels may take seconds; a busy server is slower still."""
MOST_REMEMBERED = 100_000


class Guard:
    """Child processes that try files; started when first needed, and again after each death.

    Args:
        readers: module with the dictionary `READERS` of what can be tried, see `guarded_readers`.
        children: how many files are tried at the same time.
        least_seconds: what a small file may take.
    """

    def __init__(
        self, readers: str = READERS, children: int = CHILDREN, least_seconds: float = LEAST_SECONDS
    ) -> None:
        self._readers = readers
        self._children = children
        self._least_seconds = least_seconds
        # The last in, first out: a child that runs is taken before one that must be started.
        self._free: queue.LifoQueue[_Child | None] = queue.LifoQueue()
        for _ in range(children):
            self._free.put(None)
        self._passed: set[tuple[str, str]] = set()

    def check(self, kind: str, path: Path, name: str) -> None:
        """Try a file, which messages call `name`; one whose content has passed is not tried again.

        Raises:
            StereocalError: it crashes its decoder, takes too long or too much memory, or is gone.
        """
        try:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            size = path.stat().st_size
        except OSError as error:
            raise StereocalError(f"{name} cannot be read: {error.strerror or error}.") from error
        if (kind, digest) in self._passed:
            return
        seconds = self._least_seconds + SECONDS_PER_MB * size / 1e6
        answer = self._ask(kind, path, seconds)
        if answer != SURVIVED:
            reason = {
                MEMORY: "needs too much memory to be decoded",
                FAILED: "makes its decoder fail",
            }.get(answer, f"takes too long to be decoded, more than {seconds:.0f} s")
            raise StereocalError(
                f"{name}: the file {reason}, and is not read; save it anew, by another program "
                "if need be."
            )
        if len(self._passed) >= MOST_REMEMBERED:
            self._passed.clear()
        self._passed.add((kind, digest))

    def check_content(self, kind: str, content: bytes, name: str, suffix: str = "") -> None:
        """As `check`, of a file's content."""
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

        with ThreadPoolExecutor(self._children) as threads:
            found = zip(files, threads.map(reason, files.items()), strict=True)
            return {name: error for name, error in found if error is not None}

    def close(self) -> None:
        """End the children that are not at work."""
        for _ in range(self._children):
            with contextlib.suppress(queue.Empty):
                child = self._free.get_nowait()
                if child is not None:
                    child.end()
        for _ in range(self._children - self._free.qsize()):
            self._free.put(None)

    def _ask(self, kind: str, path: Path, seconds: float) -> str:
        child = self._free.get()
        try:
            if child is None:
                child = _Child(self._readers)
            answer = child.ask(kind, path, seconds)
            if child.has_ended:
                child.end()
                child = None
            return answer
        except OSError as error:
            raise StereocalError(
                f"The server cannot start the process that tries files: {error.strerror or error}."
            ) from error
        finally:
            self._free.put(child)


class _Child:
    def __init__(self, readers: str) -> None:
        self._process = subprocess.Popen(
            [sys.executable, "-m", "stereocal.system.guarded_child", readers],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
            text=True,
        )
        assert self._process.stdin is not None and self._process.stdout is not None
        self._requests, self._answers = self._process.stdin, self._process.stdout
        self.has_ended = False
        # What it takes to start is not counted against the file.
        if self._answers.readline().strip() != READY:
            self.end()
            raise OSError("it ended at once")

    def ask(self, kind: str, path: Path, seconds: float) -> str:
        """What became of the file; empty if it took too long."""
        late = threading.Event()

        def end() -> None:
            late.set()
            self._process.kill()

        timer = threading.Timer(seconds, end)
        timer.daemon = True
        timer.start()
        answer = ""
        try:
            request = {"kind": kind, "path": str(path.resolve()), "seconds": seconds}
            self._requests.write(json.dumps(request) + "\n")
            self._requests.flush()
            answer = self._answers.readline().strip()
        except OSError:  # it has ended
            pass
        finally:
            timer.cancel()
        self.has_ended = not answer
        return answer or ("" if late.is_set() else FAILED)

    def end(self) -> None:
        self._process.kill()
        self._process.wait()
        for pipe in (self._requests, self._answers):
            with contextlib.suppress(OSError):
                pipe.close()


@cache
def server_guard() -> Guard:
    """The one of this process."""
    guard = Guard()
    atexit.register(guard.close)
    return guard
