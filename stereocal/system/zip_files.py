"""Read untrusted zip files: limits are checked first, and their paths are never written to."""

import io
import lzma
import struct
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import IO

from stereocal.errors import StereocalError
from stereocal.system.limits import Limits
from stereocal.system.names import check_path

PIECE = 1 << 20
LISTED_BYTES = 3_300
"""Upper limit for an entry in the central directory of a zip, except for extremely long names."""
_LISTED, _MEMBER = b"PK\x01\x02", b"PK\x03\x04"

DAMAGED_ZIP = (
    *(EOFError, ValueError, OSError, OverflowError, IndexError, RuntimeError),
    *(zipfile.BadZipFile, struct.error, zlib.error, lzma.LZMAError),
)
"""Exceptions of `zipfile` and its decompressors on damaged content."""


class OpenZip:
    """The files of a zip within the limits, each read on demand."""

    def __init__(self, archive: zipfile.ZipFile, source: str) -> None:
        self._archive = archive
        self._source = source
        self._members: dict[str, zipfile.ZipInfo] = {}
        for item in archive.infolist():
            if item.filename in self._members:
                raise StereocalError(
                    f"{source}: two files in the zip are called {item.filename!r}; pack it "
                    "again with the right one only."
                )
            check_path(item.filename, source)
            if not item.is_dir():
                self._members[item.filename] = item

    @property
    def names(self) -> list[str]:
        """With their folders."""
        return list(self._members)

    def size(self, name: str) -> int:
        """Unpacked size of a file in bytes, according to the zip's directory."""
        return self._members[name].file_size

    def modified(self, name: str) -> float | None:
        """When a file was changed, in s since 1970, in steps of 2 s and by a local clock; None if
        the zip does not say."""
        with suppress(ValueError, OverflowError):
            return datetime(*self._members[name].date_time, tzinfo=UTC).timestamp()
        return None

    def read(self, name: str) -> bytes:
        """A file's content; `zipfile` reads at most `size` bytes."""
        return b"".join(self.pieces(name))

    def pieces(self, name: str) -> Iterator[bytes]:
        """A file's content, a megabyte at a time."""
        with _sound(self._source):
            member = self._archive.open(self._members[name])
        with member:
            while True:
                with _sound(self._source):
                    piece = member.read(PIECE)
                if not piece:
                    return
                yield piece


def is_zip(content: bytes) -> bool:
    """Whether it is a zip of files, which one of NumPy's arrays is not."""
    return content.startswith(_MEMBER) and not is_npz(content)


def is_npz(content: bytes) -> bool:
    """Whether it is NumPy's .npz: a zip whose first member is an array."""
    length = int.from_bytes(content[26:28], "little")
    return content.startswith(_MEMBER) and content[30 : 30 + length].endswith(b".npy")


@contextmanager
def open_zip(source: Path | bytes, name: str) -> Iterator[OpenZip]:
    """Open a zip file or its content, called `name` in messages."""
    limits = Limits.from_environment()
    with ExitStack() as opened:
        with _sound(name):
            file: IO[bytes] = opened.enter_context(
                io.BytesIO(source) if isinstance(source, bytes) else source.open("rb")
            )
            packed = file.seek(0, io.SEEK_END)
            if not packed:
                raise StereocalError(f"{name}: the file is empty (0 bytes).")
            # Count the entries before `zipfile` reads them into memory (1 kB each). An entry that
            # straddles two pieces is missed here, and counted below.
            file.seek(int(max(packed - LISTED_BYTES * limits.files, 0)))
            pieces = iter(partial(file.read, PIECE), b"")
            limits.check_count(sum(piece.count(_LISTED) for piece in pieces), name)
            members = OpenZip(opened.enter_context(zipfile.ZipFile(file)), name)
        # The directory, before anything is unpacked.
        limits.check_count(len(members.names), name)
        total = sum(map(members.size, members.names))
        limits.check_together(total, name)
        limits.check_expansion(packed, total, name)
        for member in members.names:
            limits.check_size(members.size(member), f"{name}: {member}")
        if not members.names:
            raise StereocalError(f"{name}: the zip is empty.")
        yield members


def unzip(
    source: Path | bytes, name: str, wanted: Callable[[str], bool] = lambda _: True
) -> dict[str, bytes]:
    """The wanted files of a zip by name, in memory."""
    with open_zip(source, name) as opened:
        names = [member for member in opened.names if wanted(member)]
        total = sum(map(opened.size, names))
        Limits.from_environment().check_size(total, f"{name}: the tables inside, together")
        return {member: opened.read(member) for member in names}


@contextmanager
def _sound(source: str) -> Iterator[None]:
    try:
        yield
    except DAMAGED_ZIP as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(f"{source}: this is not a valid zip file ({error}).") from error


def pack_zip(files: Mapping[str, bytes]) -> bytes:
    """A zip of files by name; deterministic."""
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in files.items():
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return packed.getvalue()
