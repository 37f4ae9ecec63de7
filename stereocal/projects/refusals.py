"""What SQLite and the disk say, as sentences; and patience where another tab or server writes."""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from stereocal.errors import StereocalError

T = TypeVar("T")
PATIENCE_S = 120.0
"""Another tab may store 900 MB meanwhile, which takes a tenth of this."""
AGAIN_S = 0.02
FULL_DISK = "The disk is full. Nothing was changed: remove something from it, and try again."
DAMAGED_FILE = (
    "The project's file is damaged. It is kept as it is: on the Start page, what can still be read "
    "is taken into a new project."
)
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_PROTOCOL)


class DamagedError(StereocalError):
    """A project, or something in it, that cannot be read: not one of another version."""


class FullError(StereocalError):
    """The disk is full."""


def patiently(act: Callable[[], T]) -> T:
    """What an act gives, which is repeated while another tab or server has the file."""
    until = time.monotonic() + PATIENCE_S
    while True:
        try:
            return act()
        except sqlite3.OperationalError as error:
            if code_of(error) not in BUSY or time.monotonic() > until:
                raise
        time.sleep(AGAIN_S)


@contextmanager
def told() -> Iterator[None]:
    """What SQLite and the disk say, as a sentence.

    Raises:
        StereocalError: what is wrong and what to do.
    """
    try:
        yield
    except sqlite3.Error as error:
        raise _sentence(error) from error
    except UnicodeError as error:  # in what SQLite says of a damaged file
        raise DamagedError(DAMAGED_FILE) from error


def _sentence(error: sqlite3.Error) -> Exception:
    code = code_of(error)
    if code == sqlite3.SQLITE_FULL:
        return FullError(FULL_DISK)
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
            BUSY, "Another tab or server has been writing to this project for two minutes: wait, "
            "and try again.",
        ),
    }  # fmt: skip
    if code in sentences:
        return StereocalError(sentences[code])
    # What is asked is always the same: that it cannot be answered, the file is to blame for.
    damaged = type(error) in (sqlite3.OperationalError, sqlite3.DatabaseError)
    return DamagedError(DAMAGED_FILE) if damaged else error


def code_of(error: sqlite3.Error) -> int:
    """The primary one of SQLite's result codes; 0 for errors of Python's own."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF
