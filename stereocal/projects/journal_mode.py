"""Which journal SQLite can use in a folder: a write-ahead log, or a rollback journal.

A write-ahead log needs shared memory, which many network file systems and some local ones lack. So
it is tested by a real write, once per folder and process.
"""

from __future__ import annotations

import sqlite3
import uuid
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from typing import Literal

Journal = Literal["wal", "delete"]
PROBE = ".probe-"
SUFFIXES = ("", "-wal", "-shm", "-journal")
"""Suffixes of a database and of SQLite's files beside it."""


@cache
def journal_of(folder: Path) -> Journal:
    """The journal of the databases in a folder."""
    return "wal" if _writes_ahead(folder) else "delete"


def remove_database(path: Path) -> None:
    """Delete a database and SQLite's files beside it.

    Raises:
        OSError: it cannot be deleted.
    """
    for suffix in SUFFIXES:
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def _writes_ahead(folder: Path) -> bool:
    """Whether a second connection sees what the first writes to a write-ahead log."""
    path = folder / f"{PROBE}{uuid.uuid4().hex}"
    try:
        with closing(sqlite3.connect(path)) as first:
            if first.execute("PRAGMA journal_mode = WAL").fetchone() != ("wal",):
                return False
            with first:
                first.execute("CREATE TABLE probe (value)")
                first.execute("INSERT INTO probe VALUES (1)")
            with closing(sqlite3.connect(path)) as second:
                return bool(second.execute("SELECT value FROM probe").fetchall() == [(1,)])
    except sqlite3.Error:
        return False
    finally:
        with suppress(OSError):
            remove_database(path)
