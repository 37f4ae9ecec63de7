"""Where a server keeps projects, and which names are a project's own."""

from __future__ import annotations

import os
import re
import secrets
import sys
from pathlib import Path

from stereocal.errors import StereocalError

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


def own_file(folder: Path, name: str) -> Path:
    """The file `name` of a folder of a project.

    Raises:
        StereocalError: a name that leads out of the folder; a project can come from a stranger.
    """
    if not isinstance(name, str) or Path(name).name != name or name in ("", ".", ".."):
        raise StereocalError(f"The project names {name!r}, which is no file of its own.")
    return folder / name


def private_folder(path: Path) -> Path:
    """A folder that only the server's own user may look into; made if it is not there.

    Raises:
        StereocalError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
        path.chmod(0o700)
    except OSError as error:
        raise StereocalError(f"{path} cannot be made: {error.strerror or error}.") from error
    return path
