"""Zips from people: bounded before they are unpacked, and no path of theirs is ever written to."""

from __future__ import annotations

import io
import lzma
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from stereocal.errors import StereocalError

MOST_FILES = 20_000
MOST_BYTES = 2_000_000_000
"""In memory, together."""
MOST_UNPACKED = 20_000_000_000
"""On disk, together: 2000 pairs of photographs of 5 MB."""
MOST_SWELLING = 200
"""A table of numbers packs to a fifth; a file that swells two hundredfold is a trap."""
FREE_SWELLING = 10_000_000
"""What may swell any much: a black photograph, a table of equal numbers."""
PIECE = 1 << 20

DAMAGED_ZIP = (
    zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError, ValueError, OSError,
    OverflowError, IndexError, struct.error, zlib.error, lzma.LZMAError,
)  # fmt: skip
"""All that `zipfile` and its decompressors raise on damaged content."""


class OpenZip:
    """The files of a zip that has passed the bounds, each read when it is asked for."""

    def __init__(self, archive: zipfile.ZipFile, source: str) -> None:
        self._archive = archive
        self._source = source
        self._members = {item.filename: item for item in archive.infolist() if not item.is_dir()}

    @property
    def names(self) -> list[str]:
        """The names of the files, with their folders."""
        return list(self._members)

    def size(self, name: str) -> int:
        """Bytes of a file, unpacked, as the zip says."""
        return self._members[name].file_size

    def read(self, name: str) -> bytes:
        """A file's content, no more than the zip says.

        Raises:
            StereocalError: the file is damaged.
        """
        return b"".join(self.pieces(name))

    def pieces(self, name: str) -> Iterator[bytes]:
        """As `read`, a megabyte at a time."""
        with _sound(self._source):
            member: IO[bytes] = self._archive.open(self._members[name])
        with member:
            left = self.size(name)
            while left > 0:
                with _sound(self._source):
                    piece = member.read(min(PIECE, left))
                if not piece:
                    return
                left -= len(piece)
                yield piece


@contextmanager
def open_zip(source: Path | bytes, name: str) -> Iterator[OpenZip]:
    """Open a zip, a file or its content, which messages call `name`.

    Raises:
        StereocalError: not a zip, empty, damaged, or suspiciously large inside.
    """
    with _sound(name):
        packed = len(source) if isinstance(source, bytes) else source.stat().st_size
    if not packed:
        raise StereocalError(f"{name}: the file is empty (0 bytes).")
    with _sound(name):
        archive = zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source)
    with archive:
        opened = OpenZip(archive, name)
        count, total = len(opened.names), sum(map(opened.size, opened.names))
        if count > MOST_FILES or total > MOST_UNPACKED:
            raise StereocalError(f"{name}: {count} files of {total} bytes inside are too many.")
        if total > MOST_SWELLING * packed + FREE_SWELLING:
            raise StereocalError(
                f"{name}: {packed} bytes would swell to {total}; it is not unpacked."
            )
        if not count:
            raise StereocalError(f"{name}: the zip is empty.")
        yield opened


def unzip(
    source: Path | bytes, name: str, wanted: Callable[[str], bool] = lambda _: True
) -> dict[str, bytes]:
    """The wanted files of a zip by name, in memory.

    Raises:
        StereocalError: as `open_zip`, or too much for the memory.
    """
    with open_zip(source, name) as opened:
        names = [member for member in opened.names if wanted(member)]
        total = sum(map(opened.size, names))
        if total > MOST_BYTES:
            raise StereocalError(f"{name}: {total} bytes of tables inside are too many.")
        return {member: opened.read(member) for member in names}


@contextmanager
def _sound(source: str) -> Iterator[None]:
    try:
        yield
    except DAMAGED_ZIP as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(f"{source}: this is not a sound zip file ({error}).") from error


def pack_zip(files: Mapping[str, bytes]) -> bytes:
    """A zip of files by name; the same files give the same bytes."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
