"""A file that reserves disk space, so that data can be deleted from a full disk.

To delete 1 GB from a database, SQLite first writes 2.5 MB to its log.
"""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

NAME = ".reserve"
BYTES = 16_000_000


def keep_reserve(folder: Path) -> None:
    """Create the reserve, unless the disk is too full for it."""
    path = folder / NAME
    try:
        if path.exists() and path.stat().st_size >= BYTES:
            return
        with path.open("wb") as file:
            file.write(os.urandom(BYTES))  # random, in case the disk compresses
    except OSError:
        drop_reserve(folder)


def drop_reserve(folder: Path) -> None:
    """Remove the reserve before a deletion that needs the space."""
    with suppress(OSError):
        (folder / NAME).unlink(missing_ok=True)
