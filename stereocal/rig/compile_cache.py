"""Choose numba's cache folder when the installation folder is read-only.

Compiled code is kept beside the sources, or else in the user's cache folder. If numba can write to
neither, its import fails: for instance a system-wide installation run by a user without a home.
"""

import os
import stat
import sys
import tempfile
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

VARIABLE = "NUMBA_CACHE_DIR"
PACKAGE = Path(__file__).parents[1]


def use_writable_cache() -> None:
    """Make numba cache compiled code in a writable folder.

    Nothing changes if `NUMBA_CACHE_DIR` is writable, or not set and the folder of the sources is
    writable. Otherwise it is set, which child processes inherit: to a folder in the user's cache
    folder, or else to one in the temporary folder that has the same name each time.
    """
    configured = os.environ.get(VARIABLE)
    if _can_write(Path(configured)) if configured else _can_write_beside():
        return
    folder = next(filter(_is_ours, _candidates()), None)
    if folder is None:
        folder = Path(tempfile.mkdtemp(prefix="stereocal-"))
    os.environ[VARIABLE] = str(folder)
    if "numba" in sys.modules:  # it has read the environment already
        sys.modules["numba"].config.CACHE_DIR = str(folder)


def _can_write_beside() -> bool:
    """Whether the `__pycache__` folder of the package is writable."""
    cache = PACKAGE / "__pycache__"
    return os.access(cache if cache.exists() else PACKAGE, os.W_OK | os.X_OK)


def _candidates() -> Iterator[Path]:
    with suppress(RuntimeError):  # a user without a home
        yield Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "stereocal"
    yield Path(tempfile.gettempdir()) / f"stereocal-compiled-{_user()}"


def _can_write(folder: Path) -> bool:
    """Whether files can be created in the folder, which is created if it is missing."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_ours(folder: Path) -> bool:
    """Whether this user and no other can write to the folder, since cached code is executed."""
    if not _can_write(folder):
        return False
    status = folder.lstat()
    private = status.st_uid == _user() and not status.st_mode & 0o022
    return stat.S_ISDIR(status.st_mode) and (private or os.name == "nt")


def _user() -> int:
    return 0 if os.name == "nt" else os.getuid()
