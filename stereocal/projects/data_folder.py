"""The folder in which a server keeps projects, and the creation of a project's file."""

from __future__ import annotations

import os
import re
import secrets
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from stereocal.errors import StereocalError, disk_errors
from stereocal.projects.database import BESIDE, WAITING, create, remove_database
from stereocal.projects.files import Store
from stereocal.system.atomic_files import flush_folder, make_folder

SUFFIX = ".sqlite"
_ID = re.compile(r"[0-9a-f]{32}")


def default_home() -> Path:
    """STEREOCAL_HOME, or the user's data directory."""
    if given := os.environ.get("STEREOCAL_HOME"):
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData/Local")) / "stereocal"
    if sys.platform == "darwin":
        return Path.home() / "Library/Application Support/stereocal"
    return Path(os.environ.get("XDG_DATA_HOME", Path.home() / ".local/share")) / "stereocal"


def is_id(name: str) -> bool:
    """Whether `name` has the form of a project's id: 32 hexadecimal digits."""
    return _ID.fullmatch(name) is not None


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
