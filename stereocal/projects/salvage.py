"""What can still be read of a damaged project, as a new one."""

from __future__ import annotations

import hashlib
import json
import sqlite3
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any

from stereocal.errors import DAMAGED, StereocalError
from stereocal.projects.database import Database, connect
from stereocal.projects.files import keep_values, values_of
from stereocal.projects.folders import SUFFIX, is_id, new_database
from stereocal.projects.project import INPUT, Project
from stereocal.projects.refusals import told

COLUMNS = {
    "value": ("part", "name", "json"),
    "file": ("sha256", "stored"),
    "content": ("sha256", "bytes"),
    "named": ("part", "name", "sha256", "about"),
    "edit": ("number", "json"),
    "result": ("kind", "content"),
}
"""What is taken over, in an order in which nothing names what is not there yet."""
UNREADABLE = (*DAMAGED, sqlite3.Error)


def salvage(home: Path, project_id: str) -> tuple[Project, int]:
    """A new project with what can be read of a damaged one, which stays as it is.

    Returns:
        The project, and how many photographs and other files were lost.

    Raises:
        StereocalError: there is no such project, or nothing of it can be read.
    """
    path = home / "projects" / f"{project_id}{SUFFIX}"
    if not is_id(project_id) or not path.exists():
        raise StereocalError("There is no project at this address, or it was removed.")
    lost = 0

    def fill(database: Database) -> None:
        nonlocal lost
        with told(), closing(connect(path)) as old, database.act() as db:
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
    """Whether a row is what it was: a content is known by its digest, a value by being JSON."""
    if table == "content":
        return bool(hashlib.sha256(row[1]).hexdigest() == row[0])
    if table in ("value", "edit"):
        json.loads(row[-1])
    return all(each is not None for each in row)


def _rowids(db: sqlite3.Connection, table: str) -> Iterator[int]:
    """The rows that can be found, from either end: damage in between hides those behind it."""
    seen: set[int] = set()
    for order in ("ASC", "DESC"):
        with suppress(*UNREADABLE):
            for (at,) in db.execute(f"SELECT rowid FROM {table} ORDER BY rowid {order}"):
                if at in seen:
                    break
                seen.add(at)
    yield from sorted(seen)


def _mend(project: Project) -> None:
    """Leave out what is given where it cannot be used any more."""
    with suppress(StereocalError):
        _ = project.inputs
        return
    kept = values_of(project.database, INPUT)
    for name in kept:
        with project.database.act() as db:
            db.execute("DELETE FROM value WHERE part = ? AND name = ?", [INPUT, name])
    for name, value in kept.items():
        with suppress(StereocalError), project.database.act():
            keep_values(project.database, INPUT, {name: value})
            _ = project.inputs
