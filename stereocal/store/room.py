"""How much a project may take on disk, and what of it nobody needs any more."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.store.folders import is_id
from stereocal.store.server import ServerSettings

MB = 1e6


def size_of(folder: Path) -> int:
    """Bytes of all files below a folder; those that go meanwhile do not count."""
    return sum(size for _, size in _files(folder))


def check_room(below: Path, coming: int) -> None:
    """Refuse what would make a project larger than the server allows.

    Args:
        below: a place in the project; a place in none has no limit.
        coming: bytes that are to be stored.

    Raises:
        StereocalError: says the limit, the size now and what can be removed.
    """
    limit = ServerSettings.from_environment().project_mb * MB
    folder = next((path for path in (below, *below.parents) if is_id(path.name)), None)
    if folder is None or math.isinf(limit):
        return
    size = size_of(folder)
    if size + coming > limit:
        raise StereocalError(
            f"A project may take {limit / MB:g} MB on this server. This one has {size / MB:.1f} "
            f"MB, and {coming / MB:.1f} MB would be added: remove photographs, board photographs "
            "or further data sets that are not needed, or begin another project."
        )


def check_whole(size: int) -> None:
    """Refuse a project of so many bytes, as a copy or from elsewhere.

    Raises:
        StereocalError: says the limit and the size.
    """
    limit = ServerSettings.from_environment().project_mb * MB
    if size > limit:
        raise StereocalError(
            f"A project may take {limit / MB:g} MB on this server, and this one takes "
            f"{size / MB:.1f} MB: remove photographs or data sets from it before."
        )


def _files(folder: Path) -> Iterator[tuple[Path, int]]:
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_dir(follow_symlinks=False):
                    yield from _files(Path(entry))
                else:
                    yield Path(entry), entry.stat(follow_symlinks=False).st_size
    except OSError:
        return
