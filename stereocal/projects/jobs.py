"""Long work of a project on disk: that it runs, and what an unfinished search has found.

There is at most one job of a kind: a row while it runs. The row names a lock that its server holds:
a small database, which the operating system releases even after a kill. If nobody holds it, the job
was interrupted. Jobs are not exported or copied with a project.
"""

import hashlib
import sqlite3
import uuid
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, Literal

import cv2
import numba
import numpy as np
import scipy

import stereocal
from stereocal.errors import DAMAGED, StereocalError
from stereocal.projects.database import (
    BUSY,
    Database,
    remove_database,
    result_code,
    translated_errors,
)
from stereocal.projects.files import SUFFIX, private_folder
from stereocal.system.records import pack, unpack

SOFTWARE = " ".join(each.__version__ for each in (stereocal, np, scipy, numba, cv2))
"""Versions that results depend on."""
_HELD: dict[Path, sqlite3.Connection] = {}
"""The locks of this server, by their paths."""


class FoundBefore:
    """What an unfinished search has found, photograph by photograph; used by the job's thread. On
    a full disk nothing is stored, and the job continues.

    Args:
        of: the results, which are stored as records; those that are `unreadable` are not, so that
            they are tried again.
    """

    def __init__(self, database: Database, kind: str, of: Any) -> None:
        self._database, self._kind, self._of = database, database.scope + kind, of
        found = database.rows("SELECT key FROM found WHERE kind = ?", self._kind)
        self._keys = {str(key) for (key,) in found}

    def get(self, key: str) -> Any:
        """The result; None if there is none, it is damaged, or of other software."""
        if (own := _digest(key)) not in self._keys:
            return None
        query = "SELECT content FROM found WHERE kind = ? AND key = ?"
        try:
            found = self._database.rows(query, self._kind, own)
            return unpack(bytes(found[0][0]), self._of)
        except DAMAGED:
            self._keys.discard(own)  # it is stored again
            return None

    def keep(self, key: str, result: Any) -> None:
        """Store a result, unless it is stored."""
        own = _digest(key)
        if own in self._keys or getattr(result, "unreadable", False):
            return
        self._keys.add(own)
        with suppress(StereocalError), self._database.transaction() as db:
            row = [self._kind, own, pack(result)]
            db.execute("INSERT OR REPLACE INTO found VALUES (?, ?, ?)", row)


def _digest(key: str) -> str:
    return hashlib.sha256(f"{SOFTWARE} {key}".encode()).hexdigest()


def begin(database: Database, kind: str) -> bool:
    """Store that this server runs a job; False if another one runs one of its kind."""
    with database.transaction() as db:
        if state(database, kind) == "elsewhere":
            return False
        row = [database.scope + kind, lock_of_server(database.path.parents[1])]
        db.execute("INSERT OR REPLACE INTO job VALUES (?, ?)", row)
    return True


def end(database: Database, kind: str, failed: bool = False) -> None:
    """Store that a job does not run any more.

    Args:
        failed: what it has found stays, for the next one.
    """
    own = [database.scope + kind]
    with suppress(StereocalError), database.freeing() as db:  # else it is shown as interrupted
        db.execute("DELETE FROM job WHERE kind = ?", own)
        if not failed:
            db.execute("DELETE FROM found WHERE kind = ?", own)


def state(database: Database, kind: str) -> Literal["elsewhere", "interrupted"] | None:
    """Whether another server runs the job of a kind, or it was interrupted, unless this server runs
    it; None if none is stored."""
    found = database.rows("SELECT server FROM job WHERE kind = ?", database.scope + kind)
    if not found:
        return None
    path = _lock(database, found[0][0])
    return "elsewhere" if path not in _HELD and is_locked(path) else "interrupted"


def has_interrupted(database: Database) -> bool:
    """Whether a server ended while it ran a job of the project."""
    servers = database.rows("SELECT DISTINCT server FROM job")
    return not all(is_locked(_lock(database, name)) for (name,) in servers)


def _lock(database: Database, server: str) -> Path:
    return database.path.parents[1] / "servers" / Path(server).name


def lock_of_server(home: Path) -> str:
    """The name of the lock of this process, which it holds until it ends."""
    folder = private_folder(home / "servers")
    for path in _HELD:
        if path.parent == folder and path.exists():
            return path.name
    path = folder / f"{uuid.uuid4().hex}{SUFFIX}"
    with translated_errors():
        _HELD[path] = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        _HELD[path].execute("BEGIN EXCLUSIVE")
    return path.name


def is_locked(path: Path) -> bool:
    """Whether a running process holds this lock."""
    if not path.is_file():
        return False
    try:
        with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as db:
            db.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:  # only a lock is a sign of life, a disk that fails is none
        return result_code(error) in BUSY
    return False


def forget_released(home: Path, before: float) -> None:
    """Remove locks of servers that have ended and were taken before this time."""
    for path in (home / "servers").glob(f"*{SUFFIX}"):
        with suppress(OSError):
            if path.stat().st_mtime < before and not is_locked(path):
                remove_database(path)
