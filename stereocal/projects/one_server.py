"""One server works with a folder of projects; a second one is refused."""

import sqlite3
import threading
from contextlib import suppress
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.projects.database import result_code
from stereocal.projects.files import private_folder

LOCK = "server.sqlite"
"""The lock: a small database, which the operating system releases even after a kill."""
_HELD: dict[Path, sqlite3.Connection | None] = {}
"""By its path, the lock of this process; None where the folder can have none."""
_TAKING = threading.Lock()


def take_projects(home: Path) -> None:
    """Make this process the server of the projects below a folder, until it ends.

    Raises:
        StereocalError: another process is their server.
    """
    path = home / LOCK
    with _TAKING:
        if path not in _HELD:
            _HELD[path] = _locked(path)


def _locked(path: Path) -> sqlite3.Connection | None:
    with suppress(OSError, StereocalError):  # a folder that cannot be made is told by its use
        private_folder(path.parent)
    try:
        lock = sqlite3.connect(path, timeout=0, isolation_level=None, check_same_thread=False)
        lock.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:  # only a lock is a sign of life, a disk that fails is none
        if result_code(error) not in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED):
            return None
        raise StereocalError(
            f"Another stereocal server works with the projects in {path.parent}. Open that one in "
            "the browser; or end it, and start this one again; or give this one a folder of its "
            "own (STEREOCAL_HOME)."
        ) from error
    return lock
