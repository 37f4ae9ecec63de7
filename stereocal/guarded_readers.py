"""What the server tries in a child process before it decodes it itself: all native decoders."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import cv2

from stereocal.formats.camera_file import read_camera
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.photograph import photograph_header, read_photograph
from stereocal.formats.point_table import PointTable
from stereocal.guarded_child import GuardedReader

cv2.setNumThreads(1)
# Arrow's other pools set aside more addresses than are allowed here.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
MB = 1_000_000
SPARE = 300 * MB
BYTES_PER_PIXEL = 16
"""Four channels of 16 bits, three of them copied to be weighed, and the grey image."""


def _photograph_room(path: Path) -> int:
    header = photograph_header(path)  # Python alone looks at it, and refuses what is too large
    return SPARE + 3 * path.stat().st_size + BYTES_PER_PIXEL * header.width * header.height


def _room(path: Path) -> int:
    return SPARE + 10 * path.stat().st_size


def _read_table(path: Path) -> None:
    PointTable(path, ("u", "v"), path.name).check()


READERS: Mapping[str, GuardedReader] = {
    "photograph": GuardedReader(read_photograph, _photograph_room),
    "camera": GuardedReader(lambda path: read_camera(path.read_bytes(), path.name), _room),
    "table": GuardedReader(_read_table, lambda path: _room(path) + 700 * MB),
    "dataset": GuardedReader(
        lambda path: parse_zip(path.read_bytes(), path.name), lambda path: _room(path) + 700 * MB
    ),
}


def guarded_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Kind and path of each file of a project that native code will decode."""
    for place, kind in (("photographs/files/*", "photograph"), ("lens/*/files/*", "photograph")):
        yield from ((kind, path) for path in sorted(folder.glob(place)) if path.is_file())
    for path in sorted(folder.glob("inputs/*")):
        if path.is_file():
            yield ("dataset" if path.suffix.lower() == ".zip" else "camera"), path
    yield from (("table", path) for path in sorted(folder.glob("apply/files/*.parquet")))
