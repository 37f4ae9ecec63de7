"""Where compiled code is kept when the program's own folder cannot be written to.

numba keeps it beside the sources, or else in the user's cache folder, and refuses to be imported
where it can write to neither: a program that an administrator installed, run by a user without a
home.
"""

from __future__ import annotations

import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
PACKAGE = Path(__file__).parents[1]


def use_writable_cache(package: Path = PACKAGE) -> None:
    """Have numba keep compiled code in a folder that can be written to.

    `NUMBA_CACHE_DIR` and the folder of the sources come first. Otherwise `NUMBA_CACHE_DIR` is set,
    so that child processes use the same folder: one in the user's cache folder, or else one below
    the temporary folder, which is the same each time.
    """
    given = os.environ.get(VARIABLE)
    if (given and _can_write(Path(given))) or _can_write_beside(package):
        return
    folder = next(filter(_is_ours, _candidates()), None)
    if folder is None:
        folder = Path(tempfile.mkdtemp(prefix="stereocal-"))
    os.environ[VARIABLE] = str(folder)
    if "numba" in sys.modules:  # it has read the environment already
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _can_write_beside(package: Path) -> bool:
    """Whether all sources of a package have a `__pycache__` that can be written to."""
    folders = [package, *(path.parent for path in package.rglob("__init__.py"))]
    caches = [folder / "__pycache__" for folder in folders]
    return all(
        os.access(cache if cache.exists() else cache.parent, os.W_OK | os.X_OK) for cache in caches
    )


def _candidates() -> Iterator[Path]:
    with suppress(RuntimeError):  # a user without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stereocal"
    yield Path(tempfile.gettempdir()) / f"stereocal-compiled-{_user()}"


def _can_write(folder: Path) -> bool:
    """Whether there is such a folder, or can be, and files can be made in it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_ours(folder: Path) -> bool:
    """Whether this user can write to a folder, and no other: compiled code is run unseen."""
    if not _can_write(folder):
        return False
    found = folder.lstat()
    private = found.st_uid == _user() and not found.st_mode & 0o022
    return stat.S_ISDIR(found.st_mode) and (private or os.name == "nt")


def _user() -> int:
    return 0 if os.name == "nt" else os.getuid()
