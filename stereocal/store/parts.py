"""What a job has finished, on disk part by part, so that it need not be computed again.

A file of records, to which each part is appended: a header (magic, lengths, checksums), the key and
the content, plain bytes that `pack` made. Nothing is flushed to the disk: a part that a power cut
takes is computed again, and so is one that is damaged.
"""

from __future__ import annotations

import logging
import os
import struct
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Generic, TypeVar

from stereocal.errors import DAMAGED as UNREADABLE
from stereocal.errors import StereocalError

T = TypeVar("T")
HEADER = struct.Struct("<4sIII")
"""Magic, lengths of key and content, checksum of both; the header's own checksum follows."""
CHECK = struct.Struct("<I")
MAGIC = b"PRT1"
DAMAGED = (*UNREADABLE, zipfile.BadZipFile, zlib.error)
_LOG = logging.getLogger(__name__)


class Parts(Generic[T]):
    """The parts of one stage of a job; for one thread of one process at a time.

    Args:
        pack: a part as bytes; None for one that is not worth keeping.
        unpack: the inverse; one of `DAMAGED` says that it cannot be done.

    Raises:
        StereocalError: the file cannot be opened for writing.
    """

    def __init__(
        self, path: Path, pack: Callable[[T], bytes | None], unpack: Callable[[bytes], T]
    ) -> None:
        self.path = path
        self._pack, self._unpack = pack, unpack
        self._places: dict[str, tuple[int, int, int]] = {}
        """Where the record's key begins, its length with the content, and their checksum."""
        self._full = False
        try:
            self._handle: int | None = os.open(path, os.O_RDWR | os.O_CREAT | _BINARY, 0o600)
            self._end = self._read_places(self._handle)
            os.ftruncate(self._handle, self._end)
        except OSError as error:
            raise StereocalError(
                f"The project's folder cannot be written to: {error.strerror or error}."
            ) from error

    def __len__(self) -> int:
        return len(self._places)

    def get(self, key: str) -> T | None:
        """The part; None where there is none, or it is damaged."""
        if key not in self._places or self._handle is None:
            return None
        offset, length, check = self._places[key]
        record = _read(self._handle, offset, length)
        if zlib.crc32(record) != check:
            return None
        try:
            return self._unpack(record[len(key.encode()) :])
        except DAMAGED:
            return None

    def keep(self, key: str, part: T) -> None:
        """Append a part. On a full disk nothing is kept any more, and the job goes on."""
        content = None if self._full or self._handle is None else self._pack(part)
        if content is None or self._handle is None:
            return
        name = key.encode()
        record = name + content
        check = zlib.crc32(record)
        header = HEADER.pack(MAGIC, len(name), len(content), check)
        whole = header + CHECK.pack(zlib.crc32(header)) + record
        try:
            _write(self._handle, self._end, whole)
        except OSError as error:
            _LOG.warning("Finished parts of a job are not kept any more: %s", error)
            self._full = True
            return
        self._places[key] = (self._end + len(whole) - len(record), len(record), check)
        self._end += len(whole)

    def close(self) -> None:
        """Let go of the file."""
        if self._handle is not None:
            os.close(self._handle)
            self._handle = None

    def _read_places(self, handle: int) -> int:
        """Find the records; where the last sound header's record ends."""
        size, at = os.fstat(handle).st_size, 0
        while at + HEADER.size + CHECK.size <= size:
            header = _read(handle, at, HEADER.size + CHECK.size)
            magic, key, content, check = HEADER.unpack_from(header)
            begins = at + len(header)
            sound = CHECK.unpack_from(header, HEADER.size)[0] == zlib.crc32(header[: HEADER.size])
            if magic != MAGIC or not sound or begins + key + content > size:
                break
            name = _read(handle, begins, key).decode(errors="replace")
            self._places[name] = (begins, key + content, check)
            at = begins + key + content
        return at


_BINARY: int = getattr(os, "O_BINARY", 0)


def _read(handle: int, offset: int, length: int) -> bytes:
    os.lseek(handle, offset, os.SEEK_SET)
    pieces = []
    while length > 0 and (piece := os.read(handle, length)):
        pieces.append(piece)
        length -= len(piece)
    return b"".join(pieces)


def _write(handle: int, offset: int, content: bytes) -> None:
    """All or nothing, as far as a disk that is full lets it: what was begun is cut off again."""
    os.lseek(handle, offset, os.SEEK_SET)
    left = memoryview(content)
    try:
        while left:
            left = left[os.write(handle, left) :]
    except OSError:
        os.ftruncate(handle, offset)
        raise
