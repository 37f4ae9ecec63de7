"""One server works with a folder of projects; a second one is refused."""

import sqlite3
import threading
from contextlib import closing, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from stereocal.errors import StereocalError
from stereocal.projects.database import BUSY, result_code
from stereocal.projects.files import private_folder

LOCK, LOCK_BEFORE = "server.lock", "server.sqlite"
"""The lock, which the operating system releases even after a kill; that of earlier versions."""
_HELD: dict[Path, FileLock] = {}
"""The lock of this process by its folder; it is not locked where the folder can have no lock."""
_TAKING = threading.Lock()


def take_projects(home: Path) -> None:
    """Make this process the server of the projects below a folder, until it ends.

    Raises:
        StereocalError: another process is their server.
    """
    with _TAKING:
        if home in _HELD:
            return
        # A soft lock, in place of one that the disk has not, would outlive a kill.
        lock = FileLock(home / LOCK, timeout=0, thread_local=False, fallback_to_soft=False)
        with suppress(StereocalError, OSError):  # a folder that cannot be made is told by its use
            private_folder(home)
        try:
            _remove_lock_before(home / LOCK_BEFORE)
            lock.acquire()
        except Timeout as error:
            raise StereocalError(
                f"Another stereocal server works with the projects in {home}. Open that one in the "
                "browser; or end it, and start this one again; or give this one a folder of its "
                "own (STEREOCAL_HOME)."
            ) from error
        except (OSError, sqlite3.Error, NotImplementedError):
            pass  # only a lock is a sign of life, a disk that fails is none
        _HELD[home] = lock


def _remove_lock_before(path: Path) -> None:
    """Remove the lock of a server of an earlier version, which held a database locked.

    Raises:
        Timeout: it is still running.
    """
    if path.is_file():
        with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as lock:
            try:
                lock.execute("BEGIN EXCLUSIVE")
            except sqlite3.Error as error:
                if result_code(error) in BUSY:
                    raise Timeout(str(path)) from error
        path.unlink()
