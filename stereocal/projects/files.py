"""Files, values and results of a project; files are stored by their SHA-256.

Files are stored one by one; then one short transaction names them. A content without a name is
deleted with its last name, or by a sweep once it is a day old.
"""

import hashlib
import io
import json
import re
import secrets
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import closing, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from stereocal.errors import StereocalError, disk_errors
from stereocal.projects.contents import ANY, PAGES, PAIRED, SCOPE, Key, refuse_unlisted
from stereocal.projects.database import (
    BESIDE,
    WAITING,
    DamagedError,
    Database,
    create,
    remove_database,
)
from stereocal.projects.server_settings import check_quota
from stereocal.system.atomic_files import flush_folder, make_folder
from stereocal.system.limits import MB
from stereocal.system.names import label_of

SUFFIX = ".sqlite"
LARGEST = 990_000_000
"""SQLite rows hold 1 GB at most."""
PIECE = 4_000_000
"""Contents are written and read piece by piece: a bound value is in memory three times."""
FREE = (
    "DELETE FROM file WHERE sha256 = ?1 AND NOT EXISTS "
    "(SELECT 1 FROM named WHERE named.sha256 = ?1)"
)
"""Deletes a content without a name."""


@dataclass(frozen=True)
class StoredFile:
    """A content in a project, read on demand; equal to others with the same content."""

    sha256: str
    database: Database = field(compare=False, repr=False)
    about: Any = field(default=None, compare=False)
    """What was stored with its name: its label, or more."""

    @property
    def name(self) -> str:
        return self.sha256

    @property
    def label(self) -> str:
        """Its name in messages."""
        return str(self.about)

    def read_bytes(self) -> bytes:
        return b"".join(self.pieces())

    def pieces(self) -> Iterator[bytes]:
        """The content piece by piece; damage is found after the last piece."""
        digest = hashlib.sha256()
        query = "SELECT rowid FROM content WHERE sha256 = ?"
        with self.database.reading() as db:
            if (row := db.execute(query, [self.sha256]).fetchone()) is None:
                raise DamagedError("A file has gone from the project; give it again.")
            with closing(db.blobopen("content", "bytes", row[0], readonly=True)) as blob:
                while piece := blob.read(PIECE):
                    digest.update(piece)
                    yield piece
        if digest.hexdigest() != self.sha256:
            raise DamagedError("A file of the project is damaged; give it again.")

    def copy_to(self, path: Path) -> Path:
        """Write the content to a file that the caller deletes, for libraries that read files."""
        with disk_errors("A temporary file cannot be written"), path.open("wb") as file:
            for piece in self.pieces():
                file.write(piece)
        return path


@dataclass(frozen=True)
class Store(Database):
    """The files, values and results of one project."""

    def keep_file(self, content: bytes | Path, label: str) -> StoredFile:
        """Store a content. The caller names it by `name_files`.

        Args:
            content: bytes, or a path for a large file.
            label: for messages, and to be stored with its name.
        """
        with io.BytesIO(content) if isinstance(content, bytes) else content.open("rb") as source:
            size = source.seek(0, io.SEEK_END)
            if size > LARGEST:
                raise StereocalError(
                    f"{label}: a file of a project may have {LARGEST / MB:g} MB, and this one has "
                    f"{size / MB:.1f} MB."
                )
            source.seek(0)
            sha256 = hashlib.file_digest(source, "sha256").hexdigest()
            stored = StoredFile(sha256, self, label_of(label))
            with self.transaction() as db:
                again = "UPDATE file SET stored = ? WHERE sha256 = ?"
                if db.execute(again, [time.time(), sha256]).rowcount:
                    return stored
                check_quota(self.size, size)
                db.execute("INSERT INTO file VALUES (?, ?)", [sha256, time.time()])
                empty = "INSERT INTO content VALUES (?, zeroblob(?)) RETURNING rowid"
                ((rowid,),) = db.execute(empty, [sha256, size]).fetchall()
                source.seek(0)
                with closing(db.blobopen("content", "bytes", rowid)) as blob:
                    while piece := source.read(PIECE):
                        blob.write(piece)
        return stored

    def files(self, part: str) -> dict[str, StoredFile]:
        rows = self.rows(
            "SELECT name, sha256, about FROM named WHERE part = ? ORDER BY rowid", self.scope + part
        )
        return {name: StoredFile(sha256, self, loaded(about)) for name, sha256, about in rows}

    def file(self, part: str, name: str) -> StoredFile | None:
        return self.files(part).get(name)

    def name_files(self, part: str, files: Mapping[str, StoredFile]) -> None:
        """Name stored files; an existing name gets the new file."""
        refuse_unlisted("named", part)
        with self.transaction() as db:
            for name, file in files.items():
                key, about = [self.scope + part, name], json.dumps(file.about, allow_nan=False)
                if not self.rows("SELECT 1 FROM file WHERE sha256 = ?", file.sha256):
                    raise StereocalError(f"{name} has gone from the project; give it again.")
                query = "SELECT sha256 FROM named WHERE part = ? AND name = ?"
                replaced = self.rows(query, *key)
                db.execute(
                    "INSERT INTO named (part, name, sha256, about) VALUES (?, ?, ?, ?) "
                    "ON CONFLICT DO UPDATE SET sha256 = excluded.sha256, about = excluded.about",
                    [*key, file.sha256, about],
                )
                db.executemany(FREE, replaced)

    def give(self, part: str, name: str, label: str, content: bytes) -> StoredFile:
        with self.transaction():
            file = self.keep_file(content, label)
            self.name_files(part, {name: file})
        return file

    def replace_files(self, part: str, files: Mapping[str, StoredFile]) -> None:
        """Make these files, and no others, a part of the project."""
        with self.transaction():
            self.name_files(part, files)
            self.forget_files(part, self.files(part).keys() - files.keys())

    def forget_files(self, part: str, names: Collection[str] | None = None) -> None:
        """Remove the names of a part, all or some, and contents that no other name uses."""
        scoped_part = self.scope + part
        with self.freeing() as db:
            for name, file in self.files(part).items():
                if names is None or name in names:
                    db.execute("DELETE FROM named WHERE part = ? AND name = ?", [scoped_part, name])
                    db.execute(FREE, [file.sha256])

    def of_pair(self, name: str) -> "Store":
        """The store of the results of a pair of a rig."""
        return replace(self, scope=f"{SCOPE}{name}/")

    def of_page(self, page: str) -> "Store":
        """The store of the photographs that are given on another page, of a project or a pair."""
        assert page in PAGES, page
        return replace(self, scope=f"{self.scope or SCOPE}{page}/")

    def forget_pairs(self) -> None:
        """Delete the results of all pairs; the project's own pages stay."""
        with self.transaction() as db:
            for table, column in PAIRED.items():
                pages = "".join(f" AND {column} NOT GLOB '{SCOPE}{page}/*'" for page in PAGES)
                db.execute(f"DELETE FROM {table} WHERE {column} GLOB '{SCOPE}*'{pages}")

    def forget_all(self, key: Key) -> None:
        """Delete all of an entry of `contents`, of the project itself, its pairs and its pages."""
        table, part, name = key
        where, values = "1", list[str]()
        if part:
            where = f"({PAIRED[table]} = ? OR {PAIRED[table]} GLOB ?)"
            values = [part, f"*/{part}"]
        if name != ANY:
            where, values = f"{where} AND name = ?", [*values, name]
        # Of files the entry is when they were given.
        act = (
            f"UPDATE file SET stored = {time.time()}" if table == "file" else f"DELETE FROM {table}"
        )
        with self.transaction() as db:
            db.execute(f"{act} WHERE {where}", values)

    def free_unnamed(self, before: float) -> None:
        """Delete contents without a name.

        Args:
            before: seconds since 1970; later ones stay: an upload in progress may name them.
        """
        where = "FROM file WHERE stored < ? AND sha256 NOT IN (SELECT sha256 FROM named)"
        if self.rows(f"SELECT 1 {where} LIMIT 1", before):
            with self.freeing() as db:
                db.execute(f"DELETE {where}", [before])

    def values(self, part: str) -> dict[str, Any]:
        """The values of a part by name."""
        rows = self.rows("SELECT name, json FROM value WHERE part = ?", self.scope + part)
        return {str(name): loaded(text) for name, text in rows}

    def keep_values(self, part: str, values: Mapping[str, Any]) -> None:
        """Store values; existing names are replaced."""
        refuse_unlisted("value", part, values)
        part = self.scope + part
        rows = [(part, name, json.dumps(value, allow_nan=False)) for name, value in values.items()]
        with self.transaction() as db:
            db.executemany("INSERT OR REPLACE INTO value VALUES (?, ?, ?)", rows)

    def result(self, kind: str) -> bytes | None:
        """The stored result of a kind; None without one."""
        rows = self.rows("SELECT content FROM result WHERE kind = ?", self.scope + kind)
        if rows and not isinstance(rows[0][0], bytes):
            raise DamagedError("A result in the project's file is damaged.")
        return rows[0][0] if rows else None

    def result_digest(self, kind: str) -> str | None:
        """SHA-256 of the stored result of a kind; None without one."""
        rows = self.rows("SELECT sha256 FROM result WHERE kind = ?", self.scope + kind)
        return rows[0][0] if rows else None

    def keep_result(self, kind: str, content: bytes | None) -> str:
        """Replace a result; None deletes it. Returns its SHA-256, if any."""
        refuse_unlisted("result", kind)
        digest = hashlib.sha256(content or b"").hexdigest()
        with self.transaction() as db:
            db.execute("DELETE FROM result WHERE kind = ?", [self.scope + kind])
            if content is not None:
                row = self.scope + kind, content, digest
                db.execute("INSERT INTO result VALUES (?, ?, ?)", row)
        return digest


def loaded(text: str) -> Any:
    """A JSON value of a project."""
    try:
        return json.loads(text)
    except (ValueError, TypeError, RecursionError) as error:
        raise DamagedError("Something in the project's file is damaged.") from error


def is_id(name: str) -> bool:
    """Whether `name` has the form of a project's id: 32 hexadecimal digits."""
    return re.fullmatch("[0-9a-f]{32}", name) is not None


def private_folder(path: Path) -> Path:
    """Create a folder, if missing, that only the server's own user may read."""
    with disk_errors(f"The folder {path.name} cannot be made"):
        make_folder(path)
        if path.stat().st_mode & 0o777 != 0o700:
            path.chmod(0o700)
    return path


def store_of(home: Path, project_id: str) -> Store:
    """The store of a project, which need not exist."""
    if not is_id(project_id):
        raise StereocalError("The address does not name a project.")
    return Store(home / "projects" / f"{project_id}{SUFFIX}")


def new_database(
    home: Path, fill: Callable[[Store], object], make: Callable[[Path], object] = create
) -> Store:
    """A new project's file under an unguessable id; it appears once it is complete.

    Args:
        fill: writes the first content.
        make: creates the database.
    """
    folder = private_folder(home / "projects")
    name = secrets.token_hex(16)
    waiting, target = folder / f"{WAITING}{name}{SUFFIX}", folder / f"{name}{SUFFIX}"
    try:
        with disk_errors("The project cannot be stored"):
            make(waiting)
            fill(Store(waiting))
            if any(waiting.with_name(waiting.name + suffix).exists() for suffix in BESIDE):
                raise StereocalError("The project's file is still open.")
            waiting.rename(target)
            flush_folder(folder)
    finally:
        with suppress(OSError):
            remove_database(waiting)
    return Store(target)
