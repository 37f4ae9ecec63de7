"""A project's SQLite file: transactions, reading, and what goes wrong as one sentence.

A connection lasts for one act or one reading; tabs, jobs and servers share the file. SQLite does
the locking between them and the recovery after a kill or a power cut.
"""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote

from stereocal.errors import StereocalError
from stereocal.projects.journal import journal_of
from stereocal.projects.refusals import (
    FULL_DISK,
    PATIENCE_S,
    DamagedError,
    FullError,
    code_of,
    patiently,
    told,
)
from stereocal.projects.reserve import drop_reserve, keep_reserve

T = TypeVar("T")
VERSION = 1
SCHEMA = """
CREATE TABLE value (part TEXT, name TEXT, json TEXT NOT NULL, PRIMARY KEY (part, name));
CREATE TABLE file (sha256 TEXT PRIMARY KEY, stored REAL NOT NULL);
CREATE TABLE content (sha256 TEXT PRIMARY KEY REFERENCES file (sha256) ON DELETE CASCADE,
    bytes BLOB NOT NULL);
CREATE TABLE named (part TEXT, name TEXT, sha256 TEXT NOT NULL REFERENCES file (sha256),
    about TEXT NOT NULL, PRIMARY KEY (part, name));
CREATE INDEX named_file ON named (sha256);
CREATE TABLE edit (number INTEGER PRIMARY KEY, json TEXT NOT NULL);
CREATE TABLE result (kind TEXT PRIMARY KEY, content BLOB NOT NULL);
CREATE TABLE job (kind TEXT PRIMARY KEY, digest TEXT NOT NULL, record TEXT NOT NULL,
    server TEXT NOT NULL, at INTEGER NOT NULL DEFAULT 0, done INTEGER NOT NULL DEFAULT 0,
    total INTEGER NOT NULL DEFAULT 0, sentence TEXT NOT NULL DEFAULT '',
    cancel INTEGER NOT NULL DEFAULT 0);
CREATE TABLE finished (kind TEXT REFERENCES job (kind) ON DELETE CASCADE, stage TEXT, key TEXT,
    content BLOB NOT NULL, PRIMARY KEY (kind, stage, key));
"""
"""value: lengths, settings and what else is JSON. file, content: contents, apart so that a new date
does not write a large one again. named: what each content is.
edit: corrections that can be undone. result: what was computed. job, finished: long work."""
VACUUMED = 2000
"""Pages that one step gives back to the disk, 8 MB: the log of a step fits into the reserve."""
REMOVED = ".removed"


@dataclass(frozen=True)
class Database:
    """The file of one project."""

    path: Path

    @contextmanager
    def act(self, lasting: bool = True) -> Iterator[sqlite3.Connection]:
        """One act of a person: all that is done inside is there afterwards, or nothing of it.

        An act inside another one of the same thread is a part of it: alone it can fail alone.

        Args:
            lasting: False where a power cut, not a kill, may take it: it saves waiting for a disk.

        Raises:
            StereocalError: the project was removed, is damaged, or the disk is full.
        """
        outer = _open_here().get(self.path)
        if outer is not None:
            with _part_of(outer):
                yield outer
            return
        with self._connected() as db:
            db.execute(f"PRAGMA synchronous = {'FULL' if lasting else 'NORMAL'}")
            patiently(lambda: db.execute("BEGIN IMMEDIATE"))
            _open_here()[self.path] = db
            try:
                if self.marker.exists():
                    raise StereocalError(
                        "This project was removed meanwhile, and nothing more is written to it. "
                        "It can be brought back on the Start page where it was removed."
                    )
                yield db
                _check_whole(db)
                patiently(lambda: db.execute("COMMIT"))
            except BaseException:
                with suppress(sqlite3.Error):
                    db.rollback()
                raise
            finally:
                del _open_here()[self.path]

    @contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """One state of the project, whatever others write meanwhile.

        Raises:
            StereocalError: there is no such project, or it is damaged or of a newer version.
        """
        outer = _open_here().get(self.path) or _read_here().get(self.path)
        if outer is not None:
            # A second connection could wait for a writer that waits for the first.
            yield outer
            return
        with self._connected() as db:
            db.execute("BEGIN")
            patiently(lambda: db.execute("SELECT 1 FROM value LIMIT 1").fetchall())
            _read_here()[self.path] = db
            try:
                yield db
            finally:
                _read_here().pop(self.path, None)

    def rows(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        """What a query finds."""
        with self.reading() as db:
            return db.execute(query, values).fetchall()

    def free(self, remove: Callable[[sqlite3.Connection], object]) -> None:
        """Remove something and give its room back to the disk, also to one that is full.

        Raises:
            StereocalError: as `act`.
        """
        home, dropped = self.path.parent, False
        try:
            with self.act() as db:
                remove(db)
        except FullError:
            dropped = True
            drop_reserve(home)
            with self.act() as db:
                remove(db)
        if self.path not in _open_here():
            with suppress(StereocalError):  # what is not given back is used again by the project
                self._give_back()
            if dropped:
                keep_reserve(home)

    def _give_back(self) -> None:
        """Cut the file down to what is in it."""
        with self._connected() as db:
            with suppress(sqlite3.Error):
                # An eighth of the time of steps, but all that has to move goes into the log.
                db.execute("PRAGMA auto_vacuum = FULL")
                patiently(lambda: db.execute(f"PRAGMA user_version = {VERSION}"))
            db.execute("PRAGMA auto_vacuum = INCREMENTAL")
            before = -1
            while before != (before := db.execute("PRAGMA freelist_count").fetchone()[0]):
                patiently(lambda: db.execute(f"PRAGMA incremental_vacuum({VACUUMED})").fetchall())

    @property
    def marker(self) -> Path:
        """A file that is there while the project is removed; it takes no room on the disk."""
        return self.path.with_suffix(REMOVED)

    @property
    def size(self) -> int:
        """Bytes that the project takes, without those that it would use again first."""
        with self.reading() as db:
            pages, free, page = (
                db.execute(f"PRAGMA {what}").fetchone()[0]
                for what in ("page_count", "freelist_count", "page_size")
            )
        return int((pages - free) * page)

    @contextmanager
    def _connected(self) -> Iterator[sqlite3.Connection]:
        with told():
            if not self.path.exists():
                raise StereocalError("There is no project at this address, or it was removed.")
            db = connect(self.path)
            try:
                patiently(lambda: _begin(db, self.path))
                yield db
            finally:
                db.close()


def create(path: Path) -> Database:
    """A new, empty database.

    Raises:
        StereocalError: it cannot be stored.
    """
    with told():
        path.touch(0o600)
        with closing(connect(path)) as db:
            db.execute("PRAGMA auto_vacuum = INCREMENTAL")
            db.executescript(f"BEGIN; {SCHEMA} PRAGMA user_version = {VERSION}; COMMIT;")
    set_journal(path)
    return Database(path)


def set_journal(path: Path) -> None:
    """Have a file that nobody uses keep the journal that its folder can hold."""
    with told(), closing(connect(path)) as db:
        db.execute(f"PRAGMA journal_mode = {journal_of(path.parent)}")


def connect(path: Path) -> sqlite3.Connection:
    """A connection to a file that is there.

    A write-ahead log comes with a small file that connections share. A full disk has no room for
    it: then this one excludes all others. A folder that is read-only has no place for it: then the
    file cannot change either.
    """
    db = sqlite3.connect(_address(path, "mode=rw"), PATIENCE_S, isolation_level=None, uri=True)
    try:
        db.execute("PRAGMA schema_version").fetchone()
    except sqlite3.Error as error:
        if code_of(error) not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_IOERR):
            return db  # said where it is used
        db.close()
        only = "mode=rw" if os.access(path.parent, os.W_OK) else "immutable=1"
        db = sqlite3.connect(_address(path, only), PATIENCE_S, isolation_level=None, uri=True)
        db.execute("PRAGMA locking_mode = EXCLUSIVE")
    return db


def _address(path: Path, options: str) -> str:
    return f"file:{quote(str(path.absolute()))}?{options}"


def _begin(db: sqlite3.Connection, path: Path) -> None:
    # Debian's SQLite overwrites what is deleted, which costs as much room as it frees.
    for setting in ("foreign_keys = ON", "secure_delete = OFF", "trusted_schema = OFF"):
        db.execute(f"PRAGMA {setting}")
    version = db.execute("PRAGMA user_version").fetchone()[0]
    if version > VERSION:
        raise StereocalError(
            f"This project was written by a newer version of stereocal (format {version}): update "
            "stereocal to open it. It is left as it is."
        )
    if version != VERSION:
        raise DamagedError("This file is not a project of stereocal, or it is damaged.")
    if journal_of(path.parent) == "delete":
        with suppress(sqlite3.Error):  # it has come from another disk, and somebody reads it
            db.execute("PRAGMA journal_mode = DELETE")


def _check_whole(db: sqlite3.Connection) -> None:
    """Refuse to go on with an act that a full disk has taken back, whoever hid its error."""
    if not db.in_transaction:
        raise FullError(FULL_DISK)


_THREAD = threading.local()


def _open_here() -> dict[Path, sqlite3.Connection]:
    """The databases in which this thread has begun an act."""
    found: dict[Path, sqlite3.Connection] = _THREAD.__dict__.setdefault("open", {})
    return found


def _read_here() -> dict[Path, sqlite3.Connection]:
    """The databases that this thread reads."""
    found: dict[Path, sqlite3.Connection] = _THREAD.__dict__.setdefault("read", {})
    return found


@contextmanager
def _part_of(db: sqlite3.Connection) -> Iterator[None]:
    _check_whole(db)
    db.execute("SAVEPOINT part")
    try:
        yield
    except BaseException:
        with suppress(sqlite3.Error):  # the disk was full: all of it is taken back already
            db.execute("ROLLBACK TO part")
            db.execute("RELEASE part")
        raise
    db.execute("RELEASE part")
