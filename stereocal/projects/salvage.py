"""Copy the readable part of a damaged project to a new one."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from stereocal.errors import DAMAGED, StereocalError
from stereocal.projects.data_folder import SUFFIX, is_id, new_database
from stereocal.projects.database import Database, connect
from stereocal.projects.files import keep_values, values_of
from stereocal.projects.project import INPUT, Project
from stereocal.projects.sqlite_errors import translated_errors

COLUMNS = {
    "value": ("part", "name", "json"),
    "file": ("sha256", "stored"),
    "content": ("sha256", "bytes"),
    "named": ("part", "name", "sha256", "about"),
    "edit": ("number", "json"),
    "result": ("kind", "content"),
}
"""Columns to copy; a table follows the tables that it refers to."""
UNREADABLE = (*DAMAGED, sqlite3.Error)


def salvage(home: Path, project_id: str) -> tuple[Project, int]:
    """A new project with the readable part of a damaged one, which is not changed.

    Returns:
        The project, and the number of files that were lost.

    Raises:
        StereocalError: there is no such project, or nothing of it is readable.
    """
    path = home / "projects" / f"{project_id}{SUFFIX}"
    if not is_id(project_id) or not path.exists():
        raise StereocalError("There is no project at this address, or it was removed.")
    lost = 0

    def fill(database: Database) -> None:
        nonlocal lost
        with translated_errors(), closing(connect(path)) as old, database.transaction() as db:
            db.execute("PRAGMA defer_foreign_keys = ON")
            taken = sum(_take(table, old, db) for table in COLUMNS)
            lost = db.execute(
                "DELETE FROM named WHERE sha256 NOT IN "
                "(SELECT sha256 FROM content JOIN file USING (sha256))"
            ).rowcount
            db.execute("DELETE FROM file WHERE sha256 NOT IN (SELECT sha256 FROM content)")
            db.execute("DELETE FROM content WHERE sha256 NOT IN (SELECT sha256 FROM file)")
            if not taken:
                raise StereocalError("Nothing of this project can be read any more.")
            _mend(Project(database))

    return Project(new_database(home, fill)), lost


def _take(table: str, old: sqlite3.Connection, new: sqlite3.Connection) -> int:
    columns = COLUMNS[table]
    names, places = ", ".join(columns), ", ".join("?" * len(columns))
    count = 0
    for at in _rowids(old, table):
        with suppress(*UNREADABLE):
            row = old.execute(f"SELECT {names} FROM {table} WHERE rowid = ?", [at]).fetchone()
            if row is None or not _is_sound(table, row):
                continue
            new.execute(f"INSERT OR IGNORE INTO {table} ({names}) VALUES ({places})", row)
            count += 1
    return count


def _is_sound(table: str, row: tuple[Any, ...]) -> bool:
    """Whether a row is undamaged: contents must match their digest, values must be JSON."""
    if table == "content":
        return bool(hashlib.sha256(row[1]).hexdigest() == row[0])
    if table in ("value", "edit"):
        json.loads(row[-1])
    return all(each is not None for each in row)


def _rowids(db: sqlite3.Connection, table: str) -> Iterator[int]:
    """The readable row ids, from both ends: a damaged page hides the rows behind it."""
    seen: set[int] = set()
    for order in ("ASC", "DESC"):
        with suppress(*UNREADABLE):
            for (at,) in db.execute(f"SELECT rowid FROM {table} ORDER BY rowid {order}"):
                if at in seen:
                    break
                seen.add(at)
    yield from sorted(seen)


def _mend(project: Project) -> None:
    """Remove inputs that are no longer valid."""
    with suppress(StereocalError):
        _ = project.inputs
        return
    kept = values_of(project.database, INPUT)
    for name in kept:
        with project.database.transaction() as db:
            db.execute("DELETE FROM value WHERE part = ? AND name = ?", [INPUT, name])
    for name, value in kept.items():
        with suppress(StereocalError), project.database.transaction():
            keep_values(project.database, INPUT, {name: value})
            _ = project.inputs
