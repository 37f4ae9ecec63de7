"""The progress of a command, on stderr."""

from __future__ import annotations

import sys
import time


class ProgressBar:
    """A line on stderr that fills, with the time that is left."""

    def __init__(self, what: str) -> None:
        self.what = what
        self.started = time.monotonic()

    def show(self, done: int, total: int) -> None:
        """Draw the line; the last call ends it."""
        left = (time.monotonic() - self.started) * (total - done) / max(done, 1)
        filled = 30 * done // total
        line = (
            f"[{'#' * filled}{' ' * (30 - filled)}] {done}/{total} {self.what}, {left:.0f} s left"
        )
        print(f"\r{line:<70}", end="\n" if done == total else "", file=sys.stderr, flush=True)
