"""A disk that fails, or a server that dies, at the n-th thing that is done to it.

The same action makes the same calls each time, so that every one of them can be made to fail.
"""

from __future__ import annotations

import builtins
import errno
import io
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

WRITING = (
    "open", "fsync", "replace", "rename", "mkdir", "link", "unlink", "rmdir", "utime", "chmod",
)  # fmt: skip
"""Of `os`, those that change a disk; `open` when it is to write."""
EVERY_CALL = 0
CRASHED = 77
"""What a child process ends with that died at a call."""


class Disk:
    """Counts the calls that change something below a folder, and strikes at one, or at all."""

    def __init__(self, below: Path, at: int | None, strike: Callable[[str], object]) -> None:
        self.below = str(below)
        self.at = at
        self.strike = strike
        self.calls: list[str] = []

    def called(self, name: str, path: object) -> None:
        """Note a call; the strike comes before it is done."""
        text = os.fspath(path) if isinstance(path, str | os.PathLike) else ""
        if text and not str(text).startswith(self.below):
            return
        self.calls.append(f"{name} {text}")
        if self.at in (len(self.calls), EVERY_CALL):
            self.strike(self.calls[-1])


@contextmanager
def watched(disk: Disk) -> Iterator[Disk]:
    """All that is done to the disk inside goes through `disk`."""
    real = {name: getattr(os, name) for name in WRITING if hasattr(os, name)}
    real_io, real_open = io.open, builtins.open

    def wrap(name: str) -> Callable[..., Any]:
        def call(*given: Any, **named: Any) -> Any:
            writes = name != "open" or (len(given) > 1 and given[1] & (os.O_WRONLY | os.O_RDWR))
            if writes:
                disk.called(name, given[0])
            return real[name](*given, **named)

        return call

    def opened(file: Any, mode: str = "r", *given: Any, **named: Any) -> Any:
        if set(mode) & set("wax+"):
            disk.called("write", file)
            found = real_io(file, mode, *given, **named)
            return _Watched(found, disk) if "b" in mode else found
        return real_io(file, mode, *given, **named)

    try:
        for name in real:
            setattr(os, name, wrap(name))
        io.open = opened
        builtins.open = opened
        yield disk
    finally:
        for name, function in real.items():
            setattr(os, name, function)
        io.open = real_io
        builtins.open = real_open


class _Watched:
    """A file whose writes are counted, and which is full at the one that fails."""

    def __init__(self, file: Any, disk: Disk) -> None:
        self._file = file
        self._disk = disk

    def write(self, content: bytes) -> int:
        self._disk.called("content", "")
        written: int = self._file.write(content)
        return written

    def __enter__(self) -> _Watched:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def __getattr__(self, name: str) -> Any:
        return getattr(self._file, name)


def count_calls(below: Path, act: Callable[[], object]) -> list[str]:
    """What an action does to the disk below a folder."""
    with watched(Disk(below, None, lambda _: None)) as disk:
        act()
    return disk.calls


def fail_at(below: Path, at: int, act: Callable[[], object], code: int = errno.ENOSPC) -> None:
    """Do an action whose n-th call fails, or every call."""

    def strike(_: str) -> None:
        raise OSError(code, os.strerror(code))

    with watched(Disk(below, at, strike)):
        act()


def die_at(below: Path, at: int, act: Callable[[], object]) -> int:
    """Do an action in a child process that dies at the n-th call, without a word; its status."""
    child = os.fork()
    if child == 0:
        status = 1
        try:
            with watched(Disk(below, at, lambda _: os._exit(CRASHED))):
                act()
            status = 0
        finally:
            os._exit(status)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
