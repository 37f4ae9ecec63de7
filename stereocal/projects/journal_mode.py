"""Which journal SQLite can use in a folder: a write-ahead log, or a rollback journal.

A write-ahead log needs shared memory, which network file systems and some local ones lack. So it is
tested by a real write, once per folder and process.
"""

from __future__ import annotations

import os
import sqlite3
import uuid
from contextlib import closing, suppress
from functools import cache
from pathlib import Path
from typing import Literal

Journal = Literal["wal", "delete"]
REMOTE = frozenset((
    "9p", "afs", "beegfs", "ceph", "cifs", "coda", "davfs", "fuse.glusterfs", "fuse.s3fs",
    "fuse.sshfs", "gfs2", "glusterfs", "lustre", "ncpfs", "nfs", "nfs4", "ocfs2", "smb3", "smbfs",
    "vboxsf",
))  # fmt: skip
MOUNTS = Path("/proc/mounts")
PROBE = ".probe-"
SUFFIXES = ("", "-wal", "-shm", "-journal")
"""Suffixes of a database and of SQLite's files beside it."""


@cache
def journal_of(folder: Path) -> Journal:
    """The journal of the databases in a folder."""
    return "wal" if not is_remote(folder) and _writes_ahead(folder) else "delete"


def is_remote(folder: Path, mounts: Path = MOUNTS) -> bool:
    """Whether a folder is on a network disk; False if unknown."""
    try:
        rows = [line.split() for line in mounts.read_text(encoding="utf-8").splitlines()]
        at = os.path.realpath(folder)
    except (OSError, UnicodeDecodeError):
        return False
    best, kind = "", ""
    for row in rows:
        if len(row) < 3:
            continue
        place = row[1].replace("\\040", " ")
        if at == place or at.startswith(place.rstrip("/") + "/"):
            # Of several mounts at the same place the last one is visible.
            best, kind = max((best, kind), (place, row[2]), key=lambda found: len(found[0]))
            kind = row[2] if best == place else kind
    return kind in REMOTE


def remove_database(path: Path) -> None:
    """Delete a database and SQLite's files beside it.

    Raises:
        OSError: it cannot be deleted.
    """
    for suffix in SUFFIXES:
        path.with_name(path.name + suffix).unlink(missing_ok=True)


def _writes_ahead(folder: Path) -> bool:
    """Whether a second connection sees what the first writes to a write-ahead log."""
    path = folder / f"{PROBE}{uuid.uuid4().hex}"
    try:
        with closing(sqlite3.connect(path)) as first:
            if first.execute("PRAGMA journal_mode = WAL").fetchone() != ("wal",):
                return False
            with first:
                first.execute("CREATE TABLE probe (value)")
                first.execute("INSERT INTO probe VALUES (1)")
            with closing(sqlite3.connect(path)) as second:
                return bool(second.execute("SELECT value FROM probe").fetchall() == [(1,)])
    except sqlite3.Error:
        return False
    finally:
        with suppress(OSError):
            remove_database(path)
