"""Which jobs are running: each locks a small database until its process ends.

The operating system releases the lock, even after a kill.
"""

from __future__ import annotations

import sqlite3
import uuid
from contextlib import closing, suppress
from pathlib import Path

from stereocal.projects.data_folder import SUFFIX, private_folder
from stereocal.projects.database import remove_database
from stereocal.projects.sqlite_errors import BUSY, result_code, translated_errors

_HELD: dict[str, sqlite3.Connection] = {}


def lock(home: Path) -> str:
    """The name of a new lock, which this process holds."""
    name = f"{uuid.uuid4().hex}{SUFFIX}"
    path = private_folder(home / "servers") / name
    with translated_errors():
        _HELD[name] = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        _HELD[name].execute("BEGIN EXCLUSIVE")
    return name


def release(home: Path, name: str) -> None:
    """Release a lock of this process."""
    if name in _HELD:
        _HELD.pop(name).close()
        with suppress(OSError):
            remove_database(home / "servers" / name)


def is_locked(home: Path, name: str) -> bool:
    """Whether a running process holds this lock."""
    path = home / "servers" / Path(name).name
    if not path.is_file():
        return False
    try:
        with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as db:
            db.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:  # only a lock is a sign of life, a disk that fails is none
        return result_code(error) in BUSY
    return False


def forget_released(home: Path, before: float) -> None:
    """Remove locks that were left by killed processes and taken before this time."""
    for path in (home / "servers").glob(f"*{SUFFIX}"):
        with suppress(OSError):
            if path.stat().st_mtime < before and not is_locked(home, path.name):
                remove_database(path)
