"""Where a server keeps projects, and which names are a project's own."""

from __future__ import annotations

import os
import re
import secrets
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.locking import locked
from stereocal.system.atomic_files import flush_folder, flush_tree, make_folder

WAITING = ".new."
"""How the name of a project's folder begins while it is not complete."""
UNCHANGING = ("inputs", "files")
"""Folders of a project whose files are named by their content and never change."""
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


def new_id() -> str:
    """An id that nobody can guess: 128 random bits."""
    return secrets.token_hex(16)


def is_id(name: str) -> bool:
    """Whether this can be a project's id: 32 hexadecimal digits."""
    return _ID.fullmatch(name) is not None


LONGEST_NAME = 100


def own_file(folder: Path, name: str) -> Path:
    """The file `name` of a folder of a project.

    Raises:
        StereocalError: a name that leads out of the folder; a project can come from a stranger.
    """
    if (
        not isinstance(name, str)
        or not 0 < len(name) <= LONGEST_NAME
        or not name.isascii()
        or not name.isprintable()
        or Path(name).name != name
        or name in (".", "..")
    ):
        raise StereocalError(f"The project names {name!r}, which is no file of its own.")
    return folder / name


def private_folder(path: Path) -> Path:
    """A folder that only the server's own user may look into; made if it is not there.

    Raises:
        StereocalError: it cannot be made.
    """
    try:
        make_folder(path)
        if path.stat().st_mode & 0o777 != 0o700:
            path.chmod(0o700)
    except OSError as error:
        raise StereocalError(
            f"The folder {path.name} cannot be made: {error.strerror or error}."
        ) from error
    return path


def new_project_folder(home: Path, fill: Callable[[Path], object]) -> Path:
    """A new project's folder, which appears when it is complete.

    Args:
        fill: puts the project's files into a folder.

    Raises:
        StereocalError: it cannot be made, or the disk is full; nothing is left.
    """
    parent = private_folder(home / "projects")
    waiting = None
    try:
        waiting = Path(tempfile.mkdtemp(dir=parent, prefix=WAITING))
        with locked(waiting):
            fill(waiting)
            flush_tree(waiting)
        target = parent / new_id()
        waiting.rename(target)
        flush_folder(parent)
    except OSError as error:
        raise StereocalError(f"The project cannot be stored: {error.strerror or error}.") from error
    finally:
        if waiting is not None:
            shutil.rmtree(waiting, ignore_errors=True)
    return target
