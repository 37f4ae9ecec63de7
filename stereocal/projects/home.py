"""The projects of a server: list, copy, remove, bring back, and delete old ones.

<home>/projects/<id>.sqlite     a project
<home>/projects/<id>.removed    marks it as removed, at the time of this file
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.projects.card import title_of
from stereocal.projects.data_folder import SUFFIX, WAITING, is_id, new_database, private_folder
from stereocal.projects.database import REMOVED, Database, set_journal
from stereocal.projects.files import free_unnamed
from stereocal.projects.jobs import interrupted
from stereocal.projects.journal_mode import PROBE, remove_database
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings
from stereocal.projects.servers import forget_dead
from stereocal.projects.sqlite_errors import DamagedError
from stereocal.system.atomic_files import flush_folder
from stereocal.system.limits import MB

DAY_S = 86_400.0
RESULTS = ("calibration", "evaluation")


@dataclass(frozen=True)
class Listed:
    """A project in the list of projects."""

    id: str
    title: str
    """As `title_of`; empty if it cannot be read."""
    changed: float
    """Seconds since 1970."""
    finished: tuple[str, ...] = ()
    """Which of `RESULTS` exist."""
    interrupted: bool = False
    damaged: bool = False
    unreadable: str = ""
    """Why it cannot be read though it is not damaged: it is of a newer version."""


@dataclass(frozen=True)
class Removed:
    """A project in the list of removed projects."""

    id: str
    title: str
    """As in `Listed`."""
    removed: float
    """Seconds since 1970."""


def find_projects(home: Path, search: str = "") -> list[str]:
    """The projects' ids, the one changed last first, damaged ones included.

    Args:
        search: only those whose title contains it, in any case.
    """
    dated = [(changed_at(path), path) for path in _files(home) if not _marker(path).exists()]
    wanted = search.strip().casefold()
    return [
        path.stem
        for changed, path in sorted(dated, reverse=True)
        if not wanted or wanted in _title(path, changed).casefold()
    ]


def recent_projects(home: Path, ids: Iterable[str] | None = None) -> list[Listed]:
    """The entries of these projects, or of all, newest first."""
    found: list[Listed] = []
    for project_id in find_projects(home) if ids is None else ids:
        path = home / "projects" / f"{project_id}{SUFFIX}"
        try:
            found.append(listed(Project(Database(path))))
        except DamagedError:
            found.append(Listed(project_id, "", changed_at(path), damaged=True))
        except StereocalError as error:
            found.append(Listed(project_id, "", changed_at(path), unreadable=str(error)))
    return found


def listed(project: Project) -> Listed:
    """A project's entry in the list."""
    database = project.database
    there = {str(kind) for (kind,) in database.rows("SELECT kind FROM result")}
    return Listed(
        project.id,
        title_of(project),
        changed_at(database.path),
        tuple(kind for kind in RESULTS if kind in there),
        bool(interrupted(database)),
    )


def removed_projects(home: Path) -> list[Removed]:
    """The removed projects, the one removed last first, damaged ones included."""
    dated = [(removed_at(home, path.stem), path) for path in _files(home)]
    there = sorted(((when, path) for when, path in dated if when is not None), reverse=True)
    return [Removed(path.stem, _title(path, changed_at(path)), when) for when, path in there]


def removed_at(home: Path, project_id: str) -> float | None:
    """When a project was removed, in seconds since 1970; None if it was not."""
    path = home / "projects" / f"{project_id}{SUFFIX}"
    if not is_id(project_id) or not path.exists():
        return None
    try:
        return _marker(path).stat().st_mtime
    except OSError:
        return None


def changed_at(path: Path) -> float:
    """When a project's file was last changed, in seconds since 1970; 0 if it is gone."""
    newest = 0.0
    for name in (path.name, f"{path.name}-wal"):
        with suppress(OSError):
            newest = max(newest, path.with_name(name).stat().st_mtime)
    return newest


def duplicate(home: Path, project_id: str) -> Project:
    """A copy under a new id, without jobs."""
    source = Project.open(home, project_id)
    check_size(source.database.size)

    def copied(path: Path) -> Database:
        copy_database(source.database, path)
        return Database(path)

    def fill(database: Database) -> None:
        with database.transaction() as db:
            db.execute("DELETE FROM job")
        copy = Project(database)
        copy.rename(f"{title_of(source)} (copy)")

    return Project(new_database(home, fill, copied))


def copy_database(database: Database, path: Path) -> None:
    """Back up a project to another file. Copying an open file would not be safe."""
    with database.reading() as db:
        db.execute("ROLLBACK")
        db.execute("VACUUM INTO ?", [str(path)])
    set_journal(path)


def remove(home: Path, project_id: str) -> None:
    """Mark a project as removed, even a damaged one; `bring_back` undoes it."""
    path = home / "projects" / f"{project_id}{SUFFIX}"
    if not is_id(project_id) or not path.exists() or _marker(path).exists():
        raise StereocalError("There is no project at this address, or it was removed.")
    try:
        _marker(path).touch()
        flush_folder(path.parent)
    except OSError as error:
        raise StereocalError(
            f"The project cannot be removed: {error.strerror or error}."
        ) from error


def bring_back(home: Path, project_id: str) -> Project:
    """Undo `remove`.

    Raises:
        StereocalError: it is not among the removed projects.
    """
    if removed_at(home, project_id) is None:
        raise StereocalError("This project was brought back already, or it was removed for good.")
    path = home / "projects" / f"{project_id}{SUFFIX}"
    with suppress(OSError):
        os.utime(path)  # else the sweep would remove it again as unused
        _marker(path).unlink(missing_ok=True)
        flush_folder(path.parent)
    return Project.open(home, project_id)


def delete(home: Path, project_id: str) -> None:
    """Delete a removed project for good.

    Raises:
        StereocalError: it is not among the removed projects, or it cannot be deleted.
    """
    if removed_at(home, project_id) is None:
        raise StereocalError("This project was brought back already, or it was removed for good.")
    path = home / "projects" / f"{project_id}{SUFFIX}"
    try:
        remove_database(path)
        _marker(path).unlink(missing_ok=True)
    except OSError as error:
        raise StereocalError(
            f"The project cannot be deleted: {error.strerror or error}."
        ) from error


def check_size(size: int) -> None:
    """Check the size in bytes of a project to be copied or imported.

    Raises:
        StereocalError: it exceeds the server's limit.
    """
    limit = ServerSettings.from_environment().project_mb * MB
    if size > limit:
        raise StereocalError(
            f"A project may take {limit / MB:g} MB on this server, and this one takes "
            f"{size / MB:.1f} MB: remove photographs or data sets from it first."
        )


def sweep(
    home: Path, removed_days: float, unused_days: float = math.inf, now: float | None = None
) -> int:
    """Delete projects removed `removed_days` ago; remove those unchanged for `unused_days`.

    Unused contents and files left by killed servers are deleted once they are a day old.

    Returns:
        The number of projects removed or deleted.
    """
    now = time.time() if now is None else now
    folder = private_folder(home / "projects")
    count = 0
    for path in _files(home):
        removed = removed_at(home, path.stem)
        with suppress(StereocalError):
            if removed is not None and now - removed > removed_days * DAY_S:
                delete(home, path.stem)
                count += 1
            elif removed is None and now - changed_at(path) > unused_days * DAY_S:
                remove(home, path.stem)
                count += 1
            elif removed is None:
                free_unnamed(Database(path), now - DAY_S)
    for path in folder.iterdir():
        alone = path.suffix == REMOVED and not path.with_suffix(SUFFIX).exists()
        with suppress(OSError):
            if (alone or path.name.startswith((WAITING, PROBE))) and (
                path.stat().st_mtime < now - DAY_S
            ):
                path.unlink()
    forget_dead(home, now - DAY_S)
    return count


def _files(home: Path) -> list[Path]:
    """The files of all projects, removed ones included; none if the folder cannot be read."""
    try:
        return [path for path in (home / "projects").glob(f"*{SUFFIX}") if is_id(path.stem)]
    except OSError:
        return []


def _marker(path: Path) -> Path:
    return Database(path).marker


@lru_cache(maxsize=4096)
def _title(path: Path, changed: float) -> str:
    """The title of a project as it was at that change; empty if it cannot be read."""
    assert changed >= 0
    try:
        return title_of(Project(Database(path)))
    except StereocalError:
        return ""
