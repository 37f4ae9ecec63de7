"""A file that holds a little of the disk free, so that a full one can still be emptied.

To delete 1 GB from a database, SQLite writes 2.5 MB to its log first.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

NAME = ".reserve"
BYTES = 16_000_000


def keep_reserve(folder: Path) -> None:
    """Make sure of the reserve, as far as the disk has the room."""
    path = folder / NAME
    try:
        if path.exists() and path.stat().st_size >= BYTES:
            return
        with path.open("wb") as file:
            file.write(os.urandom(BYTES))  # else a disk that compresses would hold nothing free
    except OSError:
        drop_reserve(folder)


def drop_reserve(folder: Path) -> None:
    """Let go of the reserve: what is deleted next needs it."""
    with suppress(OSError):
        (folder / NAME).unlink(missing_ok=True)
