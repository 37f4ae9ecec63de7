"""What a server that was killed leaves behind: temporary files and unfinished folders."""

from __future__ import annotations

import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

from stereocal.errors import DAMAGED
from stereocal.locking import LOCK, FileLock
from stereocal.store.folders import WAITING
from stereocal.store.projects import folders_in

_TEMPORARY = re.compile(
    r"\.new-[a-z0-9_]{8}"  # a photograph (photograph_files)
    r"|\.[^.].*\.[a-z]+\.[a-z0-9_]{8}"  # a file with a suffix (writing)
    r"|\.[0-9a-f]{20}-[a-z]+\.[a-z0-9_]{8}"  # an input without one
    r"|\.packed\.zip|\.\.packed\.zip\.part"  # a project that was packed
)


def remove_left_over(home: Path, before: float) -> int:
    """Remove what was last written before this time, and what nobody holds.

    Args:
        before: seconds since 1970.

    Returns:
        How many files and folders were removed.
    """
    count = 0
    for folder in (home / "projects").glob(f"{WAITING}*"):
        count += _remove_folder(folder, before)
    for path in (*_temporary(home), *_temporary(home / "projects")):
        count += _remove_file(path, before)
    for project in folders_in(home / "projects"):
        lock = FileLock(project / LOCK)
        try:
            if lock.acquire(wait=False):
                count += _in_project(project, before)
        except OSError:
            continue
        finally:
            lock.release()
    return count


def _in_project(project: Path, before: float) -> int:
    count = 0
    for parent, folders, _ in os.walk(project):
        folders[:] = [name for name in folders if name != "jobs"]
        for path in _temporary(Path(parent)):
            count += _remove_file(path, before)
    for folder in _unnamed_results(project):
        count += _remove_folder(folder, before)
    return count


def _temporary(folder: Path) -> Iterator[Path]:
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            if _TEMPORARY.fullmatch(entry.name) and entry.is_file(follow_symlinks=False):
                yield Path(entry)


def _unnamed_results(project: Path) -> list[Path]:
    """Tables of the Apply page in a folder that `result.json` does not name."""
    apply = project / "apply"
    if not (apply / "results").is_dir():
        return []
    try:
        named = json.loads((apply / "result.json").read_bytes())["folder"]
    except FileNotFoundError:
        named = None
    except DAMAGED:  # who knows which one it named
        return []
    return [path for path in (apply / "results").iterdir() if path.name != named]


def _remove_file(path: Path, before: float) -> bool:
    """Remove a file, unless it is young or held by who writes it."""
    lock = FileLock(path)
    try:
        if path.stat().st_mtime >= before or not lock.acquire(wait=False):
            return False
        path.unlink()
    except OSError:
        return False
    finally:
        lock.release()
    return True


def _remove_folder(folder: Path, before: float) -> bool:
    lock = FileLock(folder / LOCK)
    try:
        if _newest(folder) >= before or not lock.acquire(wait=False):
            return False
        shutil.rmtree(folder, ignore_errors=True)
    except OSError:
        return False
    finally:
        lock.release()
    return not folder.exists()


def _newest(folder: Path) -> float:
    return max(path.stat().st_mtime for path in (folder, *folder.rglob("*")))
