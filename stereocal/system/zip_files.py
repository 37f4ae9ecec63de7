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
from stereocal.system.limits import Limits

PIECE = 1 << 20
LISTED_BYTES = 3_300
"""At most so many for a file in the list at the end of a zip, but for absurdly long names."""
_LISTED = b"PK\x01\x02"

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
        self._members: dict[str, zipfile.ZipInfo] = {}
        for item in archive.infolist():
            if item.filename in self._members:
                raise StereocalError(
                    f"{source}: two files of the zip are called {item.filename!r}; pack it anew, "
                    "with the one that is meant."
                )
            if not item.is_dir():
                self._members[item.filename] = item

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
        Limits.from_environment().check_count(_listed(source, packed), name)
        archive = zipfile.ZipFile(io.BytesIO(source) if isinstance(source, bytes) else source)
    with archive:
        with _sound(name):
            opened = OpenZip(archive, name)
        _check(opened, packed, name)
        yield opened


def unzip(
    source: Path | bytes, name: str, wanted: Callable[[str], bool] = lambda _: True
) -> dict[str, bytes]:
    """The wanted files of a zip by name, in memory.

    Raises:
        StereocalError: as `open_zip`; together they may be as large as a single file.
    """
    with open_zip(source, name) as opened:
        names = [member for member in opened.names if wanted(member)]
        total = sum(map(opened.size, names))
        Limits.from_environment().check_size(total, f"{name}: the tables inside, together")
        return {member: opened.read(member) for member in names}


def _listed(source: Path | bytes, packed: int) -> int:
    """How many files a zip lists at its end, counted before `zipfile` holds them all in memory."""
    start = int(max(packed - LISTED_BYTES * Limits.from_environment().files, 0))
    if isinstance(source, bytes):
        return source.count(_LISTED, start)
    with source.open("rb") as file:
        file.seek(start)
        count, before = 0, b""
        while piece := file.read(PIECE):
            count += (before + piece).count(_LISTED)
            before = piece[-len(_LISTED) + 1 :]
        return count


def _check(opened: OpenZip, packed: int, name: str) -> None:
    """Refuse a zip by what its list of contents says, before anything is unpacked."""
    limits = Limits.from_environment()
    limits.check_count(len(opened.names), name)
    total = sum(map(opened.size, opened.names))
    limits.check_together(total, name)
    limits.check_swelling(packed, total, name)
    for member in opened.names:
        limits.check_size(opened.size(member), f"{name}: {member}")
    if not opened.names:
        raise StereocalError(f"{name}: the zip is empty.")


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
