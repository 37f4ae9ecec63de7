"""The projects of a server: list, copy, remove and bring back, and carry elsewhere.

<home>/projects/<id>/   open projects, see `project`; readable to the server's user only
<home>/removed/<id>/    removed ones, which can be brought back until `sweep` takes them
"""

from __future__ import annotations

import math
import os
import shutil
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.project import Project
from stereocal.store.folders import is_id, new_id, private_folder

DAY_S = 86_400.0
UNCHANGING = ("inputs", "files")
"""Folders whose files are named by their content: copies of a project share them on disk."""


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


def recent_projects(home: Path, most: int = 10) -> list[Listed]:
    """The projects changed last, the newest first; what cannot be read is left out."""
    found = []
    for folder in _folders(home / "projects"):
        try:
            changed = _changed(folder)
            name = Project.open(home, folder.name).inputs.name
        except (StereocalError, OSError, TypeError):
            continue
        files = {"calibration": "calibration.json", "evaluation": "evaluation.npz"}
        finished = tuple(what for what, file in files.items() if (folder / file).is_file())
        found.append(Listed(folder.name, name, changed, finished))
    return sorted(found, key=lambda listed: -listed.changed)[:most]


def duplicate(home: Path, project_id: str) -> Project:
    """A copy under a new id. Files that never change are shared on disk.

    Raises:
        StereocalError: there is no such project, or the disk is full; nothing is left behind.
    """
    source = Project.open(home, project_id)
    parent = private_folder(home / "projects")
    waiting = Path(tempfile.mkdtemp(dir=parent, prefix=".new."))
    try:
        shutil.copytree(source.folder, waiting, copy_function=_link, dirs_exist_ok=True)
        copy = Project(waiting)
        copy.rename(f"{copy.inputs.name or 'Project'} (copy)")
        target = parent / new_id()
        _rename(waiting, target)
    except (OSError, shutil.Error) as error:
        raise StereocalError(f"The project cannot be copied: {error}.") from error
    finally:
        shutil.rmtree(waiting, ignore_errors=True)
    return Project.open(home, target.name)


def remove(home: Path, project_id: str) -> None:
    """Put a project aside; `bring_back` undoes it.

    Raises:
        StereocalError: there is no such project.
    """
    project = Project.open(home, project_id)
    target = private_folder(home / "removed") / project_id
    _rename(project.folder, target)
    os.utime(target)  # `sweep` counts from here


def bring_back(home: Path, project_id: str) -> Project:
    """Undo `remove`.

    Raises:
        StereocalError: it is not among the removed ones any more.
    """
    source = home / "removed" / project_id
    if project_id not in [folder.name for folder in _folders(home / "removed")]:
        raise StereocalError("This project was removed for good.")
    _rename(source, private_folder(home / "projects") / project_id)
    return Project.open(home, project_id)


def sweep(home: Path, removed_days: float, unused_days: float = math.inf) -> int:
    """Delete what was removed so many days ago, and remove what nobody has changed for longer.

    Returns:
        How many projects were removed or deleted.
    """
    now, count = time.time(), 0
    for folder in _folders(home / "removed"):
        if now - folder.stat().st_mtime > removed_days * DAY_S:
            shutil.rmtree(folder, ignore_errors=True)
            count += 1
    for folder in _folders(home / "projects"):
        if now - _changed(folder) > unused_days * DAY_S:
            remove(home, folder.name)
            count += 1
    return count


def _changed(folder: Path) -> float:
    """When the newest file below a project's folder was written."""
    return max((path.stat().st_mtime for path in folder.rglob("*")), default=0.0)


def _folders(parent: Path) -> list[Path]:
    if not parent.is_dir():
        return []
    return [path for path in parent.iterdir() if is_id(path.name) and path.is_dir()]


def _link(source: str, target: str) -> None:
    """Share a file that never changes; copy all others."""
    if Path(source).parent.name in UNCHANGING:
        try:
            os.link(source, target)
        except OSError:  # another file system, or one without links
            shutil.copy2(source, target)
    else:
        shutil.copy2(source, target)


def _rename(source: Path, target: Path) -> None:
    try:
        source.rename(target)
    except OSError as error:
        raise StereocalError(
            f"The project's folder cannot be moved: {error.strerror or error}."
        ) from error
