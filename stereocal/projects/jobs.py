"""Long work of a project on disk: that it runs, and what an unfinished search has found.

There is at most one job of a kind: a row while it runs, with the server that runs it. If that is
another one than this, it has ended, and the job was interrupted. Jobs are not exported or copied.
"""

import hashlib
import uuid
from contextlib import suppress
from typing import Any

import cv2
import numba
import numpy as np
import scipy

import stereocal
from stereocal.errors import DAMAGED, StereocalError
from stereocal.projects.database import Database
from stereocal.system.records import pack, unpack

SOFTWARE = " ".join(package.__version__ for package in (stereocal, np, scipy, numba, cv2))
"""Versions that results depend on."""
SERVER = uuid.uuid4().hex
"""Names this process in the rows of its jobs."""


class FoundBefore:
    """What an unfinished search has found, photograph by photograph; used by the job's thread. On
    a full disk nothing is stored, and the job continues.

    Args:
        record_type: of the results, which are stored as records; those that are `unreadable` are
            not, so that they are tried again.
    """

    def __init__(self, database: Database, kind: str, record_type: Any) -> None:
        self._database, self._kind, self._record_type = database, database.scope + kind, record_type
        rows = database.rows("SELECT key FROM found WHERE kind = ?", self._kind)
        self._keys = {str(key) for (key,) in rows}

    def get(self, key: str) -> Any:
        """The result; None if there is none, it is damaged, or of other software."""
        if (digest := _digest(key)) not in self._keys:
            return None
        query = "SELECT content FROM found WHERE kind = ? AND key = ?"
        try:
            rows = self._database.rows(query, self._kind, digest)
            return unpack(bytes(rows[0][0]), self._record_type)
        except DAMAGED:
            self._keys.discard(digest)  # it is stored again
            return None

    def keep(self, key: str, result: Any) -> None:
        """Store a result, unless it is stored."""
        digest = _digest(key)
        if digest in self._keys or getattr(result, "unreadable", False):
            return
        self._keys.add(digest)
        with suppress(StereocalError), self._database.transaction() as db:
            row = [self._kind, digest, pack(result)]
            db.execute("INSERT OR REPLACE INTO found VALUES (?, ?, ?)", row)


def _digest(key: str) -> str:
    return hashlib.sha256(f"{SOFTWARE} {key}".encode()).hexdigest()


def begin(database: Database, kind: str) -> None:
    """Store that this server runs a job."""
    with database.transaction() as db:
        db.execute("INSERT OR REPLACE INTO job VALUES (?, ?)", [database.scope + kind, SERVER])


def end(database: Database, kind: str, keeps: bool = False) -> None:
    """Store that a job does not run any more.

    Args:
        keeps: what it has found stays, for the next one.
    """
    scoped_kind = [database.scope + kind]
    with suppress(StereocalError), database.freeing() as db:  # else it is shown as interrupted
        db.execute("DELETE FROM job WHERE kind = ?", scoped_kind)
        if not keeps:
            db.execute("DELETE FROM found WHERE kind = ?", scoped_kind)


def is_interrupted(database: Database, kind: str) -> bool:
    """Whether a job of a kind has begun and not ended; unless it runs here, it was interrupted."""
    return bool(database.rows("SELECT 1 FROM job WHERE kind = ?", database.scope + kind))


def has_interrupted(database: Database) -> bool:
    """Whether a server ended while it ran a job of the project."""
    return bool(database.rows("SELECT 1 FROM job WHERE server != ?", SERVER))
