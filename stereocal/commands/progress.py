"""The progress of a command, on stderr."""

from __future__ import annotations

import sys
import time


class ProgressBar:
    """A line on stderr that fills, with the time that is left.

    As a context it ends a line that an error has left open, so that the error has its own.
    """

    def __init__(self, what: str) -> None:
        self.what = what
        self.started = time.monotonic()
        self.is_open = False

    def __enter__(self) -> ProgressBar:
        return self

    def __exit__(self, *_: object) -> None:
        if self.is_open:
            print(file=sys.stderr)

    def show(self, done: int, total: int) -> None:
        """Draw the line; the last call ends it."""
        left = (time.monotonic() - self.started) * (total - done) / max(done, 1)
        filled = 30 * done // total
        line = (
            f"[{'#' * filled}{' ' * (30 - filled)}] {done}/{total} {self.what}, {left:.0f} s left"
        )
        self.is_open = done < total
        print(f"\r{line:<70}", end="" if self.is_open else "\n", file=sys.stderr, flush=True)
