"""The long work of a project: what was begun, how far it is, and what it has finished.

There is one job of a kind at a time: a row while it runs, and after it failed. It names the server
that runs it; one whose server has ended was interrupted. What it has finished are rows as well, so
that the same work goes on from there. All of it belongs to the home: it is not carried with a
project nor copied.
"""

from __future__ import annotations

import hashlib
import json
import sqlite3
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

import cv2
import numba
import numpy as np
import scipy

import stereocal
from stereocal.errors import DAMAGED, StereocalError
from stereocal.projects.database import Database
from stereocal.projects.servers import is_alive, is_this, this_server

T = TypeVar("T")
EVERY_S = 1.0
"""How far a job is, and what it has finished, is written at most so often."""
MUCH = 4_000_000
"""Bytes of finished parts that are written at once all the same."""
State = Literal["running", "interrupted", "failed"]
_HERE: set[str] = set()
"""The jobs that this process runs."""


@dataclass(frozen=True)
class Record:
    """A job that was begun."""

    kind: str
    stages: tuple[str, ...]
    """What is counted, in the order of the work."""
    digest: str
    """Of the work and of the software that does it."""
    work: Mapping[str, Any]
    """Inputs, by their digests, and settings."""
    begun: float
    """Seconds since 1970."""
    run: str = ""
    """Tells one run of the same work from another."""
    at: int = 0
    """Number of the stage."""
    done: int = 0
    total: int = 0
    sentence: str = ""
    """Why it failed; empty while it has not."""


def digest_of(kind: str, work: Mapping[str, Any]) -> str:
    """The same for the same work done by the same software."""
    software = [one.__version__ for one in (stereocal, np, scipy, numba, cv2)]
    content = json.dumps([kind, work, software], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:32]


class Parts(Generic[T]):
    """The finished parts of one stage of a job; for the thread that runs it.

    Args:
        pack: a part as bytes; None for one that is not worth keeping.
        unpack: the inverse; one of `DAMAGED` says that it cannot be done.
    """

    def __init__(
        self,
        job: KeptJob,
        stage: str,
        pack: Callable[[T], bytes | None],
        unpack: Callable[[bytes], T],
    ) -> None:
        self._job, self._stage, self._pack, self._unpack = job, stage, pack, unpack
        rows = job.database.rows(
            "SELECT key FROM finished WHERE kind = ? AND stage = ?", job.record.kind, stage
        )
        self._keys = {str(key) for (key,) in rows}

    def __len__(self) -> int:
        return len(self._keys)

    def get(self, key: str) -> T | None:
        """The part; None where there is none, or it is damaged."""
        if key not in self._keys:
            return None
        self._job.write()
        rows = self._job.database.rows(
            "SELECT content FROM finished WHERE kind = ? AND stage = ? AND key = ?",
            self._job.record.kind, self._stage, key,
        )  # fmt: skip
        try:
            return self._unpack(bytes(rows[0][0]))
        except DAMAGED:
            return None

    def keep(self, key: str, part: T) -> None:
        """Keep a part. On a full disk nothing is kept, and the job goes on."""
        content = self._pack(part)
        if content is not None:
            self._keys.add(key)
            self._job.add(self._stage, key, content)


class KeptJob:
    """A job that this process runs, made by `begin`; for the thread that runs it."""

    def __init__(self, database: Database, record: Record) -> None:
        self.database = database
        self.record = record
        self._waiting: list[tuple[str, str, str, bytes]] = []
        self._written = 0.0
        self._goes_on = True

    def parts(
        self, stage: str, pack: Callable[[T], bytes | None], unpack: Callable[[bytes], T]
    ) -> Parts[T]:
        """What the same work has finished of a stage before, and where more of it is kept."""
        return Parts(self, stage, pack, unpack)

    def add(self, stage: str, key: str, content: bytes) -> None:
        """A part is finished."""
        self._waiting.append((self.record.kind, stage, key, content))
        if sum(len(one[-1]) for one in self._waiting) > MUCH:
            self.write()
        self._write_at_times()

    def progress(self, at: int, done: int, total: int) -> bool:
        """Note how far the job is, at most once a second.

        Returns:
            False where it is to stop: somebody has asked for it, or the project was removed.
        """
        self.record = replace(self.record, at=at, done=done, total=total)
        self._write_at_times()
        return self._goes_on

    def _write_at_times(self) -> None:
        if time.monotonic() - self._written > EVERY_S:
            self.write()

    def write(self) -> None:
        """Write what is finished, and how far the job is; on a full disk the job goes on."""
        self._written = time.monotonic()
        try:
            with self.database.act(lasting=False) as db:
                self._goes_on = self._note(db)
        except StereocalError:  # a removed project ends the job, a full disk does not
            self._goes_on = self.database.path.exists() and not self.database.marker.exists()
        self._waiting.clear()

    def _note(self, db: sqlite3.Connection) -> bool:
        now = self.record
        rows = db.execute(
            "UPDATE job SET at = ?, done = ?, total = ? WHERE kind = ? AND digest = ? "
            "RETURNING cancel", [now.at, now.done, now.total, now.kind, now.digest],
        ).fetchall()  # fmt: skip
        if rows:
            db.executemany("INSERT OR REPLACE INTO finished VALUES (?, ?, ?, ?)", self._waiting)
        return bool(rows) and not rows[0][0]

    def end(self) -> None:
        """It has ended well, or was cancelled: nothing of it is kept."""
        with suppress(StereocalError):  # else it is shown as interrupted
            self.database.free(lambda db: _delete(db, self.record.kind))
        _HERE.discard(self.record.run)  # last, so that no page takes it for interrupted before

    def fail(self, sentence: str) -> None:
        """It could not be done. The reason is kept until the next, and what was finished too."""
        self.write()
        with suppress(StereocalError), self.database.act() as db:
            db.execute("UPDATE job SET sentence = ? WHERE kind = ?", [sentence, self.record.kind])
        _HERE.discard(self.record.run)


def begin(
    database: Database, kind: str, stages: Sequence[str], work: Mapping[str, Any]
) -> KeptJob | None:
    """Begin a job of a project; None where one of its kind runs, here or elsewhere.

    What the same work had finished is there again; parts of any other are removed.

    Raises:
        StereocalError: nothing can be written.
    """
    server = this_server(_home(database))
    record = Record(kind, tuple(stages), digest_of(kind, work), work, time.time(), uuid.uuid4().hex)
    text = json.dumps({name: asdict(record)[name] for name in ("stages", "work", "begun", "run")})
    with database.act() as db:
        found = find(database, kind)
        if found is not None and found[0] == "running":
            return None
        if found is not None and found[1].digest != record.digest:
            _delete(db, kind)
        db.execute(
            "INSERT INTO job (kind, digest, record, server) VALUES (?, ?, ?, ?) ON CONFLICT DO "
            "UPDATE SET record = excluded.record, server = excluded.server, at = 0, done = 0, "
            "total = 0, sentence = '', cancel = 0", [kind, record.digest, text, server],
        )  # fmt: skip
    _HERE.add(record.run)
    return KeptJob(database, record)


def find(database: Database, kind: str) -> tuple[State, Record] | None:
    """The job of this kind that a project has, and how it stands; None without one."""
    rows = database.rows(
        "SELECT digest, record, server, at, done, total, sentence FROM job WHERE kind = ?", kind
    )
    if not rows:
        return None
    digest, text, server, at, done, total, sentence = rows[0]
    try:
        content = json.loads(text)
        stages = tuple(str(stage) for stage in content["stages"])
        record = Record(
            kind, stages, digest, content["work"], float(content["begun"]), str(content["run"]),
            min(max(at, 0), len(stages) - 1), done, max(total, done), sentence,
        )  # fmt: skip
    except DAMAGED:
        return None  # nobody could go on with it
    if sentence:
        return "failed", record
    home = _home(database)
    alive = record.run in _HERE if is_this(home, server) else is_alive(home, server)
    return "running" if alive else "interrupted", record


def interrupted(database: Database) -> list[Record]:
    """The jobs of a project that ended with their server."""
    kinds = [str(kind) for (kind,) in database.rows("SELECT kind FROM job ORDER BY kind")]
    found = [find(database, kind) for kind in kinds]
    return [one[1] for one in found if one is not None and one[0] == "interrupted"]


def discard(database: Database, kind: str) -> None:
    """Forget a job that does not run, with what it had finished."""
    found = find(database, kind)
    if found is None or found[0] != "running":
        database.free(lambda db: _delete(db, kind))


def ask_to_stop(database: Database, kind: str) -> None:
    """Ask the server that runs a job to cancel it; it does so within a second or two."""
    with database.act() as db:
        db.execute("UPDATE job SET cancel = 1 WHERE kind = ?", [kind])


def _delete(db: sqlite3.Connection, kind: str) -> None:
    db.execute("DELETE FROM job WHERE kind = ?", [kind])


def _home(database: Database) -> Path:
    return database.path.parents[1]
