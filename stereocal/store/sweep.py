"""What goes by itself: projects that are too old, and what a killed server left behind.

A clock may jump. So no project goes that was not found too old in two sweeps, at least a day apart
by their own times: the first leaves a mark, and a mark from the future is worth nothing.
"""

from __future__ import annotations

import json
import math
import shutil
import time
from collections.abc import Callable
from pathlib import Path

from stereocal.errors import DAMAGED, StereocalError
from stereocal.store.left_over import remove_left_over
from stereocal.store.projects import changed_at, folders_in, remove
from stereocal.store.unused import free_unused
from stereocal.system.atomic_files import flush_folder, write_atomically

DAY_S = 86_400.0
MARKS = "too-old.json"
"""Below the home: which projects a sweep has found too old, and when."""
GONE = ".gone."
"""How the name of a project's folder begins while it is deleted."""


def sweep(
    home: Path,
    removed_days: float,
    unused_days: float = math.inf,
    clock: Callable[[], float] = time.time,
) -> int:
    """Delete what was removed so many days ago, and remove what nobody has changed for longer.

    Files that no project needs any more, and left-overs of a server that was killed, go as well.
    A project that cannot be opened, as one of a newer version, is left as it is.

    Args:
        clock: seconds since 1970.

    Returns:
        How many projects were removed or deleted.

    Raises:
        StereocalError: the marks cannot be written; no project has gone then.
    """
    now = clock()
    old = _too_old(home, now, removed_days, unused_days)
    marks = {name: when for name, when in _marks(home).items() if when <= now}
    due = [name for name in old if now - marks.get(name, now) >= DAY_S]
    kept = {name: marks.get(name, now) for name in old if name not in due}
    if kept or (home / MARKS).exists():
        write_atomically(home / MARKS, json.dumps(kept).encode())
    count = sum(_done(old[name]) for name in due)
    for path in home.glob(f"removed/{GONE}*"):
        shutil.rmtree(path, ignore_errors=True)
    remove_left_over(home, now - DAY_S)
    for folder in folders_in(home / "projects"):
        free_unused(folder, now - DAY_S)
    return count


def _too_old(
    home: Path, now: float, removed_days: float, unused_days: float
) -> dict[str, Callable[[], None]]:
    """What is too old by this clock, and how it goes."""

    def taken(folder: Path) -> Callable[[], None]:
        return lambda: remove(home, folder.name)

    def deleted(folder: Path) -> Callable[[], None]:
        return lambda: _delete(folder)

    found: dict[str, Callable[[], None]] = {}
    for folder in folders_in(home / "removed"):
        if now - folder.stat().st_mtime > removed_days * DAY_S:
            found[f"removed/{folder.name}"] = deleted(folder)
    for folder in folders_in(home / "projects"):
        changed = changed_at(folder)
        if changed and now - changed > unused_days * DAY_S:
            found[f"projects/{folder.name}"] = taken(folder)
    return found


def _marks(home: Path) -> dict[str, float]:
    """Name to the time of the sweep that found it too old; none from a file that is damaged."""
    try:
        content = json.loads((home / MARKS).read_bytes())
        return {str(name): float(when) for name, when in content.items()}
    except DAMAGED:
        return {}


def _done(act: Callable[[], None]) -> bool:
    try:
        act()
    except (StereocalError, OSError):
        return False
    return True


def _delete(folder: Path) -> None:
    """At one stroke: a server that dies over it leaves nothing that could be half brought back."""
    gone = folder.with_name(GONE + folder.name)
    folder.rename(gone)
    flush_folder(folder.parent)
    shutil.rmtree(gone, ignore_errors=True)
