"""The projects of a server: list, copy, remove and bring back.

<home>/projects/<id>/   open projects, see `project`; readable to the server's user only
<home>/removed/<id>/    removed ones, which can be brought back until `sweep` takes them
"""

from __future__ import annotations

import os
import shutil
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.project import Project
from stereocal.store.folders import UNCHANGING, is_id, new_project_folder, private_folder
from stereocal.store.room import check_whole, size_of
from stereocal.store.state import PROJECT_FILE, changing
from stereocal.system.atomic_files import flush_folder

HELD_STAYS = os.name == "nt"
"""Windows does not move a folder with an open file in it, such as the one that carries its lock."""
STATES = (".", "photographs", "lens/primary", "lens/secondary", "apply")
"""Folders of a project with files that are replaced when something changes."""


@dataclass(frozen=True)
class Listed:
    """What a list shows of a project."""

    id: str
    name: str
    """As the person called it; empty where nobody did."""
    changed: float
    """Seconds since 1970: the newest change of inputs, settings or results."""
    finished: tuple[str, ...]
    """Which results are there: calibration, evaluation."""


@dataclass(frozen=True)
class Removed:
    """What a list shows of a project that was removed."""

    id: str
    name: str
    """As the person called it; empty where nobody did, or where its file is damaged."""
    removed: float
    """Seconds since 1970."""


def recent_projects(home: Path, most: int = 10) -> list[Listed]:
    """The projects changed last, the newest first; what cannot be read is left out."""
    found: list[Listed] = []
    dated = [(changed_at(folder), folder) for folder in folders_in(home / "projects")]
    for changed, folder in sorted(dated, reverse=True):
        if len(found) == most:
            break
        with suppress(StereocalError):
            found.append(_listed(Project.open(home, folder.name), changed))
    return found


def listed(project: Project) -> Listed:
    """What a list shows of a project.

    Raises:
        StereocalError: it cannot be read.
    """
    return _listed(project, changed_at(project.folder))


def _listed(project: Project, changed: float) -> Listed:
    files = {"calibration": "calibration.json", "evaluation": "evaluation.npz"}
    finished = tuple(what for what, file in files.items() if (project.folder / file).is_file())
    return Listed(project.id, project.inputs.name, changed, finished)


def removed_projects(home: Path, most: int = 20) -> list[Removed]:
    """The projects removed last, the newest first; also those whose file is damaged."""
    dated = [(removed_at(home, folder.name), folder) for folder in folders_in(home / "removed")]
    there = sorted(((when, folder) for when, folder in dated if when is not None), reverse=True)
    return [Removed(folder.name, _name(folder), when) for when, folder in there[:most]]


def removed_at(home: Path, project_id: str) -> float | None:
    """When a project was removed, in seconds since 1970; None if it is not among the removed."""
    if not is_id(project_id):
        return None
    try:
        return (home / "removed" / project_id).stat().st_mtime
    except OSError:
        return None


def duplicate(home: Path, project_id: str) -> Project:
    """A copy under a new id. Files that never change are shared on disk.

    Raises:
        StereocalError: there is no such project, it is too large, or the disk is full; nothing is
            left behind.
    """
    source = Project.open(home, project_id)
    check_whole(size_of(source.folder))

    def fill(folder: Path) -> None:
        with changing(source.folder):
            shutil.copytree(
                source.folder, folder, copy_function=_link, dirs_exist_ok=True,
                ignore=shutil.ignore_patterns(".*", "jobs"),
            )  # fmt: skip
        copy = Project(folder)
        copy.rename(f"{copy.inputs.name or 'Project'} (copy)")

    return Project(new_project_folder(home, fill))


def remove(home: Path, project_id: str) -> None:
    """Put a project aside; `bring_back` undoes it.

    Raises:
        StereocalError: there is no such project.
    """
    project = Project.open(home, project_id)
    target = private_folder(home / "removed") / project_id
    with changing(project.folder):
        if not HELD_STAYS:
            _move(project.folder, target, now=True)
    if HELD_STAYS:
        _move(project.folder, target, now=True)


def bring_back(home: Path, project_id: str) -> Project:
    """Undo `remove`.

    Raises:
        StereocalError: it is not among the removed ones any more.
    """
    if removed_at(home, project_id) is None:
        raise StereocalError("This project was brought back already, or it was removed for good.")
    target = private_folder(home / "projects") / project_id
    _move(home / "removed" / project_id, target)
    with suppress(OSError):
        os.utime(target / PROJECT_FILE)  # else the sweep that found it too old would again
    return Project.open(home, project_id)


def changed_at(folder: Path) -> float:
    """When a project was last changed, in seconds since 1970; 0 where that cannot be told.

    Whatever changes replaces one of a few small files: photographs need not be looked at.
    """
    newest = 0.0
    for below in STATES:
        try:
            with os.scandir(folder / below) as entries:
                for entry in entries:
                    if not entry.name.startswith(".") and entry.is_file():
                        newest = max(newest, entry.stat().st_mtime)
        except OSError:
            continue
    return newest


def folders_in(parent: Path) -> list[Path]:
    """The folders of projects in a folder; none where it cannot be looked into."""
    try:
        with os.scandir(parent) as entries:
            return [Path(entry) for entry in entries if is_id(entry.name) and entry.is_dir()]
    except OSError:
        return []


def _name(folder: Path) -> str:
    try:
        return Project(folder).inputs.name
    except StereocalError:
        return ""


def _link(source: str, target: str) -> None:
    """Share a file that never changes; copy all others."""
    if Path(source).parent.name in UNCHANGING:
        try:
            os.link(source, target)
        except OSError:  # another file system, or one without links
            shutil.copy2(source, target)
    else:
        shutil.copy2(source, target)


def _move(source: Path, target: Path, now: bool = False) -> None:
    """Give a project's folder another place; `sweep` counts from its time, which is set to now."""
    try:
        if now:
            os.utime(source)
        source.rename(target)
        flush_folder(target.parent)
        flush_folder(source.parent)
    except OSError as error:
        raise StereocalError(
            f"The project's folder cannot be moved: {error.strerror or error}."
        ) from error
