"""Progress and messages of a command on stderr."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from pathlib import Path

_open: list[ProgressBar] = []
"""The progress bar on the current line, if any."""


def say(line: str) -> None:
    """Write a line to stderr, below an open progress bar."""
    _end_line()
    _write(f"{line}\n")


def report(*lines: str, notes: Iterable[str] = (), written: Iterable[Path | None] = ()) -> None:
    """Write what a command has found, its notes, and its files, a line each."""
    for line in (*lines, *(f"Note: {note}" for note in notes)):
        print(line)
    for path in filter(None, written):
        print(f"wrote {path}")


class Stages(ExitStack):
    """A progress bar for each stage of a long work."""

    def begin(self, stage: str) -> None:
        """Start the next one."""
        self._bar = self.enter_context(ProgressBar(stage))

    def show(self, done: int, total: int) -> None:
        """Progress of the present one."""
        self._bar.show(done, total)


class ProgressBar:
    """A progress bar on stderr with the time left; as a context it ends its line."""

    def __init__(self, what: str) -> None:
        self.what = what
        self.started = time.monotonic()
        self.drawn = 0.0

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        _end_line()

    def show(self, done: int, total: int) -> None:
        """Draw the bar, at most ten times a second; the last call ends the line."""
        if done < total and time.monotonic() - self.drawn < 0.1:
            return
        self.drawn = time.monotonic()
        left = (time.monotonic() - self.started) * (total - done) / max(done, 1)
        time_left = f", {left:.0f} s left" if done else ""
        filled = 30 * done // total
        line = f"[{'#' * filled}{' ' * (30 - filled)}] {done}/{total} {self.what}{time_left}"
        _open[:] = [self]
        _write(f"\r{line:<70}")
        if done >= total:
            _end_line()


def _end_line() -> None:
    if _open:
        _open.clear()
        _write("\n")


def _write(text: str) -> None:
    with suppress(OSError):  # a closed pipe must not end the work
        print(text, end="", file=sys.stderr, flush=True)
