"""Jobs of a project on disk: their state, progress and checkpoints.

There is at most one job of a kind: a row while it runs, and after it failed. The row names a lock
that its process holds: a small database, which the operating system releases even after a kill. If
nobody holds it, the job was interrupted. Its checkpoints are rows too, so the same job can resume
from them. Jobs are not exported or copied with a project.
"""

import hashlib
import json
import sqlite3
import time
import uuid
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Generic, Literal, TypeVar

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
from stereocal.system.records import of_plain

T = TypeVar("T")
WRITE_EVERY_S = 1.0
"""Interval at which progress and checkpoints are written."""
WRITE_BYTES = 4_000_000
"""Checkpoints of more bytes are written at once."""
State = Literal["running", "interrupted", "failed"]
_HELD: dict[str, sqlite3.Connection] = {}
"""The locks of this process."""


@dataclass(frozen=True)
class Record:
    """A job as stored."""

    kind: str
    stages: tuple[str, ...]
    """What is counted, in order."""
    digest: str
    """Of the work and the software."""
    at: int = 0
    """Number of the stage."""
    done: int = 0
    total: int = 0
    sentence: str = ""
    """Why it failed; empty unless it did."""


def digest_of(kind: str, work: Mapping[str, Any]) -> str:
    """A digest of the work and of the versions of the software."""
    software = [one.__version__ for one in (stereocal, np, scipy, numba, cv2)]
    content = json.dumps([kind, work, software], sort_keys=True)
    return hashlib.sha256(content.encode()).hexdigest()[:32]


class Checkpoints(Generic[T]):
    """The checkpoints of one stage of a job, earlier runs of the same work included; used by the
    thread that runs it. On a full disk none is stored, and the job continues.

    Args:
        pack: a checkpoint as bytes; None for one that is not worth storing.
        unpack: the inverse; raises one of `DAMAGED` for damaged bytes.
    """

    def __init__(
        self,
        job: "RunningJob",
        stage: str,
        pack: Callable[[T], bytes | None],
        unpack: Callable[[bytes], T],
    ) -> None:
        self._job, self._stage, self._pack, self._unpack = job, stage, pack, unpack
        query = "SELECT key FROM finished WHERE kind = ? AND stage = ?"
        self._keys = {str(key) for (key,) in job.database.rows(query, job.record.kind, stage)}

    def __len__(self) -> int:
        return len(self._keys)

    def get(self, key: str) -> T | None:
        """The checkpoint; None if there is none, or it is damaged."""
        if key not in self._keys:
            return None
        self._job.write()
        query = "SELECT content FROM finished WHERE kind = ? AND stage = ? AND key = ?"
        try:
            found = self._job.database.rows(query, self._job.record.kind, self._stage, key)
            return self._unpack(bytes(found[0][0]))
        except DAMAGED:
            return None

    def keep(self, key: str, result: T) -> None:
        content = self._pack(result)
        if content is not None:
            self._keys.add(key)
            self._job.add(self._stage, key, content)


class RunningJob:
    """A job that this process runs, created by `begin`; used by the thread that runs it."""

    def __init__(self, database: Database, record: Record, held: str) -> None:
        self.database, self.record, self._held = database, record, held
        self._waiting: list[tuple[str, str, str, bytes]] = []
        self._written = 0.0
        self._goes_on = True

    def checkpoints(
        self, stage: str, pack: Callable[[T], bytes | None], unpack: Callable[[bytes], T]
    ) -> Checkpoints[T]:
        return Checkpoints(self, stage, pack, unpack)

    def add(self, stage: str, key: str, content: bytes) -> None:
        self._waiting.append((self.record.kind, stage, key, content))
        self._write_at_times(sum(len(one[-1]) for one in self._waiting) > WRITE_BYTES)

    def progress(self, at: int, done: int, total: int) -> bool:
        """Store the progress, at most once a second.

        Returns:
            False if the job must stop: it was cancelled, or the project was removed.
        """
        self.record = replace(self.record, at=at, done=done, total=total)
        self._write_at_times()
        return self._goes_on

    def _write_at_times(self, now: bool = False) -> None:
        if now or time.monotonic() - self._written > WRITE_EVERY_S:
            self.write()

    def write(self) -> None:
        """Write progress and checkpoints; on a full disk the job continues."""
        self._written, own = time.monotonic(), self.record
        try:
            with self.database.transaction() as db:
                rows = db.execute(
                    "UPDATE job SET at = ?, done = ?, total = ? WHERE kind = ? AND digest = ? "
                    "RETURNING cancel",
                    [own.at, own.done, own.total, own.kind, own.digest],
                ).fetchall()
                if rows:
                    waiting = "INSERT OR REPLACE INTO finished VALUES (?, ?, ?, ?)"
                    db.executemany(waiting, self._waiting)
            self._goes_on = bool(rows) and not rows[0][0]
        except StereocalError:  # a removed project ends the job, a full disk does not
            self._goes_on = self.database.path.exists() and not self.database.marker.exists()
        self._waiting.clear()

    def end(self) -> None:
        """Delete a job that has finished or was cancelled."""
        with suppress(StereocalError):  # else it is shown as interrupted
            _delete(self.database, self.record.kind)
        self.leave()  # last: earlier, pages would show it as interrupted

    def fail(self, sentence: str) -> None:
        """Store why the job failed; its checkpoints stay."""
        self.write()
        with suppress(StereocalError), self.database.transaction() as db:
            db.execute("UPDATE job SET sentence = ? WHERE kind = ?", [sentence, self.record.kind])
        self.leave()

    def leave(self) -> None:
        _release(_home(self.database), self._held)


def begin(
    database: Database, kind: str, stages: Sequence[str], work: Mapping[str, Any]
) -> RunningJob | None:
    """Begin or resume a job; None if one of its kind runs, here or on another server.

    Checkpoints of the same work are used; those of other work are deleted.
    """
    own, begun = database.scope + kind, False
    record = Record(own, tuple(stages), digest_of(kind, work))
    held = lock(_home(database))
    try:
        with database.transaction() as db:
            found = find(database, kind)
            if found is not None and found[0] == "running":
                return None
            if found is not None and found[1].digest != record.digest:
                _delete(database, own)
            db.execute(
                "INSERT INTO job (kind, digest, record, server) VALUES (?, ?, ?, ?) ON CONFLICT DO "
                "UPDATE SET record = excluded.record, server = excluded.server, at = 0, done = 0, "
                "total = 0, sentence = '', cancel = 0",
                [own, record.digest, json.dumps({"stages": record.stages}), held],
            )
        begun = True
        return RunningJob(database, record, held)
    finally:
        if not begun:
            _release(_home(database), held)


def find(database: Database, kind: str) -> tuple[State, Record] | None:
    """State and record of a project's job of this kind; None without one."""
    kind = database.scope + kind
    names = ("digest", "at", "done", "total", "sentence")
    query = f"SELECT server, record, {', '.join(names)} FROM job WHERE kind = ?"
    if not (rows := database.rows(query, kind)):
        return None
    held, text, *values = rows[0]
    try:
        stored = {**json.loads(text), **dict(zip(names, values, strict=True)), "kind": kind}
        record = of_plain(stored, Record)
    except DAMAGED:
        return None  # it could not be resumed
    at, total = min(max(record.at, 0), len(record.stages) - 1), max(record.total, record.done)
    record = replace(record, at=at, total=total)
    if record.sentence:
        return "failed", record
    return "running" if is_locked(_home(database), held) else "interrupted", record


def interrupted(database: Database) -> list[Record]:
    """The jobs of a project whose server has ended."""
    kinds = [str(kind) for (kind,) in database.rows("SELECT kind FROM job ORDER BY kind")]
    found = [find(database, kind) for kind in kinds]
    return [one[1] for one in found if one is not None and one[0] == "interrupted"]


def discard(database: Database, kind: str) -> None:
    """Delete a job that is not running, with its checkpoints."""
    found = find(database, kind)
    if found is None or found[0] != "running":
        _delete(database, database.scope + kind)


def ask_to_stop(database: Database, kind: str) -> None:
    """Ask the server that runs a job to cancel it, which takes a second or two."""
    with database.transaction() as db:
        db.execute("UPDATE job SET cancel = 1 WHERE kind = ?", [database.scope + kind])


def _delete(database: Database, kind: str) -> None:
    with database.freeing() as db:
        db.execute("DELETE FROM job WHERE kind = ?", [kind])


def _home(database: Database) -> Path:
    return database.path.parents[1]


def lock(home: Path) -> str:
    """The name of a new lock, which this process holds."""
    name = f"{uuid.uuid4().hex}{SUFFIX}"
    path = private_folder(home / "servers") / name
    with translated_errors():
        _HELD[name] = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        _HELD[name].execute("BEGIN EXCLUSIVE")
    return name


def _release(home: Path, name: str) -> None:
    if name in _HELD:
        _HELD.pop(name).close()
        with suppress(OSError):
            remove_database(home / "servers" / name)


def is_locked(home: Path, name: str) -> bool:
    """Whether a running process holds this lock."""
    path = home / "servers" / Path(name).name
    if not path.is_file():
        return False
    try:
        with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as db:
            db.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:  # only a lock is a sign of life, a disk that fails is none
        return result_code(error) in BUSY
    return False


def forget_released(home: Path, before: float) -> None:
    """Remove locks that were left by killed processes and taken before this time."""
    for path in (home / "servers").glob(f"*{SUFFIX}"):
        with suppress(OSError):
            if path.stat().st_mtime < before and not is_locked(home, path.name):
                remove_database(path)
