"""What a command says on stderr while it works."""

from __future__ import annotations

import sys
import time
from contextlib import suppress

_open: list[ProgressBar] = []
"""The bar whose line is not ended, if there is one."""


def say(line: str) -> None:
    """Write a line on stderr, below a progress bar that is open there."""
    _end_line()
    _write(f"{line}\n")


class ProgressBar:
    """A line on stderr that fills, with the time that is left.

    As a context it ends a line that an error has left open, so that the error has its own.
    """

    def __init__(self, what: str) -> None:
        self.what = what
        self.started = time.monotonic()
        self.drawn = 0.0

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        _end_line()

    def show(self, done: int, total: int) -> None:
        """Draw the line, at most ten times a second; the last call ends it."""
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
    """What nobody can read any more, as in a pipe that is closed, must not end the work."""
    with suppress(OSError):
        print(text, end="", file=sys.stderr, flush=True)
