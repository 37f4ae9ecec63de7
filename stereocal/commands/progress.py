"""The progress of a command, on stderr."""

from __future__ import annotations

import sys
import time


class ProgressBar:
    """A line on stderr that fills, with the time that is left."""

    def __init__(self, what: str) -> None:
        self.what = what
        self.started = time.monotonic()
        self.drawn = 0.0

    def show(self, done: int, total: int) -> None:
        """Draw the line, at most ten times a second; the last call ends it."""
        if done < total and time.monotonic() - self.drawn < 0.1:
            return
        self.drawn = time.monotonic()
        left = (time.monotonic() - self.started) * (total - done) / max(done, 1)
        filled = 30 * done // total
        line = (
            f"[{'#' * filled}{' ' * (30 - filled)}] {done}/{total} {self.what}, {left:.0f} s left"
        )
        print(f"\r{line:<70}", end="\n" if done == total else "", file=sys.stderr, flush=True)
