"""Which servers are running: each locks a small database until its process ends.

The operating system releases the lock, even after a kill.
"""

from __future__ import annotations

import sqlite3
import threading
import uuid
from contextlib import closing, suppress
from pathlib import Path

from stereocal.projects.data_folder import SUFFIX, private_folder
from stereocal.projects.journal_mode import remove_database
from stereocal.projects.sqlite_errors import BUSY, result_code, translated_errors

_HELD: dict[Path, tuple[str, sqlite3.Connection]] = {}
_TAKING = threading.Lock()


def this_server(home: Path) -> str:
    """The name of this process among the servers of a home."""
    folder = private_folder(home / "servers")
    with _TAKING:
        if folder not in _HELD or not (folder / _HELD[folder][0]).exists():
            name = f"{uuid.uuid4().hex}{SUFFIX}"
            with translated_errors():
                db = sqlite3.connect(folder / name, isolation_level=None, check_same_thread=False)
                db.execute("BEGIN EXCLUSIVE")
            _HELD[folder] = name, db
        return _HELD[folder][0]


def is_this(home: Path, name: str) -> bool:
    """Whether this is the name of this process."""
    held = _HELD.get(home / "servers")
    return held is not None and held[0] == name


def is_alive(home: Path, name: str) -> bool:
    """Whether the process of this name is still running."""
    path = home / "servers" / Path(name).name
    if is_this(home, name) or not path.is_file():
        return is_this(home, name)
    try:
        with closing(sqlite3.connect(path, timeout=0, isolation_level=None)) as db:
            db.execute("BEGIN EXCLUSIVE")
    except sqlite3.Error as error:  # only a lock is a sign of life, a disk that fails is none
        return result_code(error) in BUSY
    return False


def forget_dead(home: Path, before: float) -> None:
    """Remove the files of servers that have ended and began before this time."""
    for path in (home / "servers").glob(f"*{SUFFIX}"):
        with suppress(OSError):
            if path.stat().st_mtime < before and not is_alive(home, path.name):
                remove_database(path)
