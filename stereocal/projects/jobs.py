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

SOFTWARE = " ".join(each.__version__ for each in (stereocal, np, scipy, numba, cv2))
"""Versions that results depend on."""
SERVER = uuid.uuid4().hex
"""Names this process in the rows of its jobs."""


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


def begin(database: Database, kind: str) -> None:
    """Store that this server runs a job."""
    with database.transaction() as db:
        db.execute("INSERT OR REPLACE INTO job VALUES (?, ?)", [database.scope + kind, SERVER])


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


def is_interrupted(database: Database, kind: str) -> bool:
    """Whether a job of a kind has begun and not ended; unless it runs here, it was interrupted."""
    return bool(database.rows("SELECT 1 FROM job WHERE kind = ?", database.scope + kind))


def has_interrupted(database: Database) -> bool:
    """Whether a server ended while it ran a job of the project."""
    return bool(database.rows("SELECT 1 FROM job WHERE server != ?", SERVER))
