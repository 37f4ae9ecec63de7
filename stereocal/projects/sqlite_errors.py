"""Error messages for SQLite's errors."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import contextmanager

from stereocal.errors import StereocalError

FULL_DISK = (
    "The disk is full. Nothing was changed. Make room on it: delete other files, or delete removed "
    "projects for good on the Start page. Then try again."
)
DAMAGED_FILE = (
    "The project's file is damaged. It is kept as it is. Open the project's last backup (its zip) "
    "on the Start page."
)
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_PROTOCOL)


class DamagedError(StereocalError):
    """A project is damaged, as opposed to written by another version."""


class DiskFullError(StereocalError):
    """The disk is full."""


@contextmanager
def translated_errors() -> Iterator[None]:
    """Turn SQLite's errors into a StereocalError."""
    try:
        yield
    except sqlite3.Error as error:
        raise _translated(error) from error
    except UnicodeError as error:  # in SQLite's message about a damaged file
        raise DamagedError(DAMAGED_FILE) from error


def _translated(error: sqlite3.Error) -> Exception:
    code = result_code(error)
    if code == sqlite3.SQLITE_FULL:
        return DiskFullError(FULL_DISK)
    sentences = {
        sqlite3.SQLITE_READONLY: "The project cannot be written to: its disk or folder is "
        "read-only.",
        sqlite3.SQLITE_PERM: "The server may not open the project's file: look at its permissions.",
        sqlite3.SQLITE_CANTOPEN: "The project's file cannot be opened: look at the permissions of "
        "its folder, and whether the disk is full.",
        sqlite3.SQLITE_IOERR: "The disk has failed to read or write the project's file: look at "
        "the disk.",
        sqlite3.SQLITE_TOOBIG: "A file is too large for a project.",
        sqlite3.SQLITE_NOMEM: "There is not enough memory for this.",
        **dict.fromkeys(
            BUSY,
            "Another tab or server has been writing to this project for two minutes: wait, "
            "and try again.",
        ),
    }
    if code in sentences:
        return StereocalError(sentences[code])
    # Our queries are fixed, so other errors mean a damaged file.
    damaged = type(error) in (sqlite3.OperationalError, sqlite3.DatabaseError)
    return DamagedError(DAMAGED_FILE) if damaged else error


def result_code(error: sqlite3.Error) -> int:
    """SQLite's primary result code; 0 for errors raised by Python."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF
