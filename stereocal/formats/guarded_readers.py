"""What the server tries in a child process before it decodes it itself: all native decoders."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import cv2

from stereocal.formats.camera_file import read_camera
from stereocal.formats.dataset_files import parse_zip
from stereocal.formats.sleap_h5 import point_text
from stereocal.matching.point_table import PointTable
from stereocal.system.guarded_child import GuardedReader, Prepared
from stereocal.system.photograph import decode_photograph, photograph_size
from stereocal.system.zip_files import unzip

cv2.setNumThreads(1)
# Arrow's other pools set aside more addresses than are allowed here.
os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")
MB = 1_000_000
SPARE = 300 * MB
LARGE = 700 * MB
BYTES_PER_PIXEL = 16
"""Four channels of 16 bits, three of them copied to be weighed, and the grey image."""


def _photograph(path: Path) -> Prepared:
    content = path.read_bytes()
    width, height = photograph_size(path)  # Python alone; refuses what is too large
    room = SPARE + 3 * len(content) + BYTES_PER_PIXEL * width * height
    return room, partial(decode_photograph, content, path.name)


def _camera(path: Path) -> Prepared:
    return _room(path), lambda: read_camera(path.read_bytes(), path.name)


def _table(path: Path) -> Prepared:
    return _room(path) + LARGE, lambda: PointTable(path, ("u", "v"), path.name).check()


def _hdf5(path: Path) -> Prepared:
    return _room(path) + LARGE, lambda: point_text(path.read_bytes(), path.name)


def _dataset(path: Path) -> Prepared:
    return _room(path) + LARGE, lambda: parse_zip(path.read_bytes(), path.name)


def _parameters(path: Path) -> Prepared:
    # Not with the others: it takes 0.4 s of the start of every child, and is seldom needed.
    from stereocal.formats.exchange.exchange import import_files
    from stereocal.formats.exchange.options import ExchangeOptions

    options = ExchangeOptions(unit="m", lens_model="brown")
    files = unzip(path.read_bytes(), path.name)
    return _room(path), lambda: import_files(files, "opencv", options, path.name)


def _room(path: Path) -> int:
    return SPARE + 10 * path.stat().st_size


READERS: Mapping[str, GuardedReader] = {
    "photograph": _photograph,
    "camera": _camera,
    "table": _table,
    "hdf5": _hdf5,
    "dataset": _dataset,
    "parameters": _parameters,
}


def guarded_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """Kind and path of each file of a project that native code will decode."""
    for place, kind in (("photographs/files/*", "photograph"), ("lens/*/files/*", "photograph")):
        yield from ((kind, path) for path in sorted(folder.glob(place)) if path.is_file())
    for path in sorted(folder.glob("inputs/*")):
        if path.is_file():
            yield ("dataset" if path.suffix.lower() == ".zip" else "camera"), path
    yield from (("parameters", path) for path in sorted(folder.glob("apply/files/*.zip")))
    yield from (("table", path) for path in sorted(folder.glob("apply/files/*.parquet")))
