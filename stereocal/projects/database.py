"""A project's SQLite file: transactions, consistent reads, and messages for SQLite's errors.

A connection lasts for one transaction or one read, or for a run of a page (`kept_open`). Tabs, jobs
and servers share the file: SQLite does the locking, and the recovery after a kill or a power cut.
"""

import hashlib
import os
import secrets
import sqlite3
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from stereocal.errors import StereocalError, damaged
from stereocal.projects.pairs_of_before import pairs_of_before

LOCK_TIMEOUT_S = 120.0
"""Ten times what another tab needs to store 900 MB."""
VERSION = 4
SCHEMA = """
CREATE TABLE value (part TEXT, name TEXT, json TEXT NOT NULL, PRIMARY KEY (part, name));
CREATE TABLE file (sha256 TEXT PRIMARY KEY, stored REAL NOT NULL);
CREATE TABLE content (sha256 TEXT PRIMARY KEY REFERENCES file (sha256) ON DELETE CASCADE,
    bytes BLOB NOT NULL);
CREATE TABLE named (part TEXT, name TEXT, sha256 TEXT NOT NULL REFERENCES file (sha256),
    about TEXT NOT NULL, PRIMARY KEY (part, name));
CREATE INDEX named_file ON named (sha256);
CREATE TABLE edit (number INTEGER PRIMARY KEY, json TEXT NOT NULL);
CREATE TABLE result (kind TEXT PRIMARY KEY, content BLOB NOT NULL, sha256 TEXT NOT NULL);
CREATE TABLE job (kind TEXT PRIMARY KEY, server TEXT NOT NULL);
CREATE TABLE found (kind TEXT, key TEXT, content BLOB NOT NULL, PRIMARY KEY (kind, key));
"""
"""value: lengths, settings and other JSON. file, content: contents; two tables, so that a new date
does not rewrite a large content. named: what each content is used for. edit: corrections that can
be undone. result: what was computed. job: what runs. found: by an unfinished search, by
photograph."""
MIGRATIONS: dict[int, tuple[str | Callable[[sqlite3.Connection], None], ...]] = {
    1: (
        "ALTER TABLE result ADD COLUMN sha256 TEXT NOT NULL DEFAULT ''",
        "UPDATE result SET sha256 = sha256(content)",
    ),
    2: (
        "DROP TABLE finished",
        "ALTER TABLE job RENAME TO job_2",
        "CREATE TABLE job (kind TEXT PRIMARY KEY, server TEXT NOT NULL)",
        "INSERT INTO job SELECT kind, server FROM job_2 WHERE sentence = ''",
        "DROP TABLE job_2",
        "CREATE TABLE found (kind TEXT, key TEXT, content BLOB NOT NULL, PRIMARY KEY (kind, key))",
    ),
    3: (pairs_of_before,),
}
"""What brings a file of a version to the next: statements, and functions."""
VACUUMED = 2000
"""Pages freed in one step, 8 MB: an almost full disk has room for the log of a step."""
REMOVED = ".removed"
NOT_THERE = "There is no project at this address, or it was removed."
WAITING = ".new-"
"""Prefix of a project's file until it is complete."""
BESIDE = ("-wal", "-shm", "-journal")
"""Suffixes of SQLite's files beside a database."""
FULL_DISK = (
    "The disk is full. Nothing was changed. Make room on it: delete other files, or delete removed "
    "projects for good on the Start page. Then try again."
)
DAMAGED_FILE = (
    "The project's file is damaged. It is kept as it is. Open the project's last backup (its zip) "
    "on the Start page."
)
BUSY = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED, sqlite3.SQLITE_PROTOCOL)
SENTENCES = {
    sqlite3.SQLITE_READONLY: "The project cannot be written to: its disk or folder is read-only.",
    sqlite3.SQLITE_PERM: "The server may not open the project's file: look at its permissions.",
    sqlite3.SQLITE_CANTOPEN: "The project's file cannot be opened: look at the permissions of its "
    "folder, and whether the disk is full.",
    sqlite3.SQLITE_IOERR: "The disk has failed to read or write the project's file: look at the "
    "disk.",
    sqlite3.SQLITE_TOOBIG: "A file is too large for a project.",
    sqlite3.SQLITE_NOMEM: "There is not enough memory for this.",
    **dict.fromkeys(
        BUSY,
        "Another tab or server has been writing to this project for two minutes: wait, and try "
        "again.",
    ),
}


class DamagedError(StereocalError):
    """A project is damaged, as opposed to written by another version."""

    lasts = False


class DiskFullError(StereocalError):
    """The disk is full."""

    lasts = False


class _Connections(threading.local):
    """The open connections of this thread."""

    def __init__(self) -> None:
        self.writing: dict[Path, sqlite3.Connection] = {}
        self.reading: dict[Path, sqlite3.Connection] = {}
        self.kept: dict[Path, sqlite3.Connection] | None = None


_OPEN = _Connections()


@dataclass(frozen=True)
class Database:
    """The file of one project."""

    path: Path
    scope: str = ""
    """Prefix of the parts and kinds, as `contents.SCOPE`."""

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """A transaction; inside another one of the same thread, a savepoint of that."""
        if (outer := _OPEN.writing.get(self.path)) is not None:
            with _at_once(outer, inside=True):
                yield outer
            return
        with self._connected() as db, _at_once(db):
            if self.marker.exists():
                raise StereocalError(
                    "This project was removed meanwhile, and nothing more is written to it. It can "
                    "be brought back on the Start page where it was removed."
                )
            _OPEN.writing[self.path] = db
            try:
                yield db
            finally:
                del _OPEN.writing[self.path]

    @contextmanager
    def reading(self) -> Iterator[sqlite3.Connection]:
        """A consistent snapshot of the project, whatever others write meanwhile."""
        if outer := _OPEN.writing.get(self.path) or _OPEN.reading.get(self.path):
            # A second connection could wait for a writer that waits for the first.
            yield outer
            return
        with self._connected() as db:
            db.execute("BEGIN")
            db.execute("SELECT 1 FROM value").fetchone()
            _OPEN.reading[self.path] = db
            try:
                yield db
            finally:
                _OPEN.reading.pop(self.path, None)
                with suppress(sqlite3.Error):
                    db.execute("ROLLBACK")

    def rows(self, query: str, *values: Any) -> list[tuple[Any, ...]]:
        with self.reading() as db:
            return db.execute(query, values).fetchall()

    @contextmanager
    def freeing(self) -> Iterator[sqlite3.Connection]:
        """A transaction that deletes, and returns the space to the disk."""
        with self.transaction() as db:
            yield db
        if self.path in _OPEN.writing:
            return
        with suppress(StereocalError), self._connected() as db:  # the project reuses free pages
            with suppress(sqlite3.Error):
                # Eight times as fast as steps, but all pages that move are written to the log.
                db.execute("PRAGMA auto_vacuum = FULL")
                db.execute(f"PRAGMA user_version = {VERSION}")
            db.execute("PRAGMA auto_vacuum = INCREMENTAL")
            left = -1
            while left != (left := db.execute("PRAGMA freelist_count").fetchone()[0]):
                db.execute(f"PRAGMA incremental_vacuum({VACUUMED})").fetchall()

    @property
    def marker(self) -> Path:
        """An empty file that exists while the project is removed."""
        return self.path.with_suffix(REMOVED)

    @property
    def size(self) -> int:
        """Bytes that the project takes, without free pages."""
        with self.reading() as db:
            names = ("page_count", "freelist_count", "page_size")
            pages, free, page = (db.execute(f"PRAGMA {name}").fetchone()[0] for name in names)
        return int((pages - free) * page)

    @contextmanager
    def _connected(self) -> Iterator[sqlite3.Connection]:
        with translated_errors():
            if not self.path.exists():
                raise StereocalError(NOT_THERE)
            if (kept := (_OPEN.kept or {}).get(self.path)) is not None:
                yield kept
                return
            with ExitStack() as until_used:
                db = until_used.enter_context(closing(_prepared(self.path)))
                # One in creation gets its name when nothing has it open.
                new = self.path.name.startswith(WAITING)
                shares = db.execute("PRAGMA locking_mode").fetchone() == ("normal",)
                if _OPEN.kept is not None and shares and not new:
                    _OPEN.kept[self.path] = db
                    until_used.pop_all()
                yield db


@contextmanager
def kept_open() -> Iterator[None]:
    """Within, this thread opens each project once, and not for each of its reads."""
    if _OPEN.kept is not None:
        yield
        return
    _OPEN.kept = {}
    try:
        yield
    finally:
        kept, _OPEN.kept = _OPEN.kept, None
        for db in kept.values():
            db.close()


def create(path: Path) -> None:
    """Create an empty database."""
    with translated_errors():
        path.touch(0o600)
        with closing(connect(path)) as db:
            db.execute("PRAGMA auto_vacuum = INCREMENTAL")
            db.executescript(f"BEGIN; {SCHEMA} PRAGMA user_version = {VERSION}; COMMIT;")
    set_journal(path)


def set_journal(path: Path) -> None:
    """Set the journal mode that the folder supports; nobody else may have the file open."""
    with translated_errors(), closing(connect(path)) as db:
        db.execute(f"PRAGMA journal_mode = {journal_of(path.parent)}")


def connect(path: Path) -> sqlite3.Connection:
    """A connection to an existing file.

    A write-ahead log needs a small file that connections share. If a full disk has no space for
    it, this connection locks all others out. In a read-only folder the file is opened as immutable.
    """

    def opened(options: str) -> sqlite3.Connection:
        address = f"file:{quote(str(path.absolute()))}?{options}"
        return sqlite3.connect(address, LOCK_TIMEOUT_S, isolation_level=None, uri=True)

    db = opened("mode=rw")
    try:
        db.execute("PRAGMA schema_version").fetchone()
    except sqlite3.Error as error:
        if result_code(error) not in (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_IOERR):
            return db  # reported by its first use
        db.close()
        db = opened("mode=rw" if os.access(path.parent, os.W_OK) else "immutable=1")
        db.execute("PRAGMA locking_mode = EXCLUSIVE")
    return db


def _prepared(path: Path) -> sqlite3.Connection:
    """A connection to a project of this version."""
    with ExitStack() as until_ready:
        db = until_ready.enter_context(closing(connect(path)))
        # Debian's SQLite overwrites what is deleted, which costs as much space as it frees.
        for name in ("secure_delete = OFF", "foreign_keys = ON", "trusted_schema = OFF"):
            db.execute(f"PRAGMA {name}")
        db.execute("PRAGMA synchronous = FULL")
        _bring_up_to_date(db)
        if journal_of(path.parent) == "delete":
            with suppress(sqlite3.Error):  # copied from another disk, and open elsewhere
                db.execute("PRAGMA journal_mode = DELETE")
        until_ready.pop_all()
    return db


def remove_database(path: Path) -> None:
    """Delete a database and SQLite's files beside it.

    Raises:
        OSError: it cannot be deleted.
    """
    for suffix in ("", *BESIDE):
        path.with_name(path.name + suffix).unlink(missing_ok=True)


@cache
def journal_of(folder: Path) -> Literal["wal", "delete"]:
    """The journal of the databases in a folder: a write-ahead log where one can be kept.

    A log needs shared memory, which many network file systems and some local ones lack. So a real
    write tells, once per folder and process.
    """
    path = folder / f"{WAITING}{secrets.token_hex(16)}"
    try:
        with closing(sqlite3.connect(path)) as writer, closing(sqlite3.connect(path)) as reader:
            set_to = writer.execute("PRAGMA journal_mode = WAL").fetchone()
            writer.execute("CREATE TABLE probe (value)")
            reader.execute("SELECT value FROM probe")
        return "wal" if set_to == ("wal",) else "delete"
    except sqlite3.Error:
        return "delete"
    finally:
        with suppress(OSError):
            remove_database(path)


@contextmanager
def translated_errors() -> Iterator[None]:
    """Turn SQLite's errors into a StereocalError."""
    try:
        yield
    except sqlite3.Error as error:
        code = result_code(error)
        if code == sqlite3.SQLITE_FULL:
            raise DiskFullError(FULL_DISK) from error
        if code in SENTENCES:
            raise StereocalError(SENTENCES[code]) from error
        if type(error) in (sqlite3.OperationalError, sqlite3.DatabaseError):  # queries are fixed
            raise DamagedError(DAMAGED_FILE) from error
        raise
    except UnicodeError as error:  # in SQLite's message about a damaged file
        raise DamagedError(DAMAGED_FILE) from error


def result_code(error: sqlite3.Error) -> int:
    """SQLite's primary result code; 0 for errors raised by Python."""
    return int(getattr(error, "sqlite_errorcode", 0)) & 0xFF


def _bring_up_to_date(db: sqlite3.Connection) -> None:
    """Bring a file of an earlier version to this one, in one transaction."""
    query = "PRAGMA user_version"
    if (version := db.execute(query).fetchone()[0]) > VERSION:
        raise StereocalError(
            f"This project was written by a newer version of stereocal (format {version}): update "
            "stereocal to open it. It is left as it is."
        )
    if version == VERSION:
        return
    db.create_function("sha256", 1, lambda content: hashlib.sha256(content).hexdigest())
    with _at_once(db):  # another server may have done it meanwhile
        for number in range(db.execute(query).fetchone()[0], VERSION):
            if number not in MIGRATIONS:
                raise DamagedError("This file is not a project of stereocal, or it is damaged.")
            with damaged("Something in the project's file is damaged.", DamagedError, keep=True):
                for change in MIGRATIONS[number]:
                    change(db) if callable(change) else db.execute(change)
            db.execute(f"PRAGMA user_version = {number + 1}")


@contextmanager
def _at_once(db: sqlite3.Connection, inside: bool = False) -> Iterator[None]:
    """What happens within is there whole or not at all; `inside` a transaction, as a savepoint."""
    if inside:
        _check_in_transaction(db)
    db.execute("SAVEPOINT part" if inside else "BEGIN IMMEDIATE")
    try:
        yield
        _check_in_transaction(db)
        db.execute("RELEASE part" if inside else "COMMIT")
    except BaseException:
        with suppress(sqlite3.Error):  # on a full disk SQLite has rolled back already
            for undo in ("ROLLBACK TO part", "RELEASE part") if inside else ("ROLLBACK",):
                db.execute(undo)
        raise


def _check_in_transaction(db: sqlite3.Connection) -> None:
    """Raise if SQLite has rolled back on a full disk, even if a caller hid its error."""
    if not db.in_transaction:
        raise DiskFullError(FULL_DISK)
