"""What the head of a photograph's file says of it, read before anything is decoded.

A decoder believes the head: one that claims 60,000 x 60,000 pixels costs gigabytes, a cut-off JPEG
comes back half grey and without a word. So the five formats are looked through here first: PNG
(W3C PNG, third edition), JPEG (ITU-T T.81, annex B), TIFF 6.0 and BigTIFF, BMP, and Netpbm.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

Format = Literal["PNG", "JPEG", "TIFF", "BMP", "PGM"]
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"


@dataclass(frozen=True)
class Header:
    """Format, size in pixels, and bits of each sample as they come out of the decoder."""

    format: Format
    width: int
    height: int
    bits: int

    @property
    def size(self) -> tuple[int, int]:
        """(width, height), as `Camera.image_size`."""
        return self.width, self.height


class UnsoundError(Exception):
    """What is wrong with a file; the text goes on after its name and a colon."""


def parse_header(content: bytes) -> Header:
    """Look a photograph's file through, from the first byte to the last.

    Raises:
        UnsoundError: none of the five formats, cut off, or of a kind that is not read.
    """
    for magic, reader in (
        (PNG_SIGNATURE, _png),
        (b"\xff\xd8\xff", _jpeg),
        (b"II*\0", _tiff),
        (b"MM\0*", _tiff),
        (b"II+\0", _tiff),
        (b"MM\0+", _tiff),
        (b"BM", _bmp),
        (b"P2", _netpbm),
        (b"P3", _netpbm),
        (b"P5", _netpbm),
        (b"P6", _netpbm),
    ):
        if content.startswith(magic):
            try:
                return reader(content)
            except (struct.error, IndexError, OverflowError) as error:
                raise UnsoundError("the file is cut off; copy it again") from error
    if not content:
        raise UnsoundError("the file is empty (0 bytes)")
    raise UnsoundError("this is no photograph (PNG, JPEG, TIFF, BMP or PGM), whatever its name")


def png_chunks(content: bytes) -> Iterator[tuple[bytes, int, int]]:
    """Type, start and end of each chunk of a PNG, to IEND; the checksums are tested on the way.

    Raises:
        UnsoundError: the file is cut off or damaged.
    """
    at, kind = len(PNG_SIGNATURE), b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", content, at)
        end = at + 12 + length
        if end > len(content):
            raise UnsoundError("the PNG is cut off; copy it again")
        data = memoryview(content)[at + 4 : end - 4]
        if zlib.crc32(data) != struct.unpack_from(">I", content, end - 4)[0]:
            raise UnsoundError("the PNG is damaged (a checksum is wrong); copy it again")
        yield kind, at, end
        at = end


def _png(content: bytes) -> Header:
    chunks = list(png_chunks(content))
    if chunks[0][0] != b"IHDR":
        raise UnsoundError("the PNG is damaged (it does not begin with its size); copy it again")
    width, height, bits = struct.unpack_from(">IIB", content, chunks[0][1] + 8)
    if any(kind == b"acTL" for kind, _, _ in chunks):
        raise UnsoundError("this is an animated PNG; save each of its images as a file of its own")
    return Header("PNG", width, height, max(bits, 8))


_SIZES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_BARE = frozenset((0x01, *range(0xD0, 0xD9)))
_AFTER_A_SCAN = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")
"""In the compressed data 0xFF is followed by 0 or is a restart mark; anything else ends them."""


def _jpeg(content: bytes) -> Header:
    sizes = [at for mark, at in _jpeg_segments(content) if mark in _SIZES]
    if not sizes:
        raise UnsoundError("the JPEG holds no image; copy it again")
    bits, height, width = struct.unpack_from(">BHH", content, sizes[0] + 4)
    if bits != 8:
        raise UnsoundError(f"this JPEG has {bits} bits; save it as PNG or TIFF with 16 bits")
    return Header("JPEG", width, height, bits)


def _jpeg_segments(content: bytes) -> Iterator[tuple[int, int]]:
    """Mark and start of each segment, to the end mark; previews inside them are stepped over."""
    at = 2
    while True:
        if content[at] != 0xFF:
            raise UnsoundError("the JPEG is damaged; copy it again")
        mark = content[at + 1]
        if mark == 0xD9:
            return
        if mark == 0xFF:
            at += 1
        elif mark in _BARE:
            at += 2
        else:
            yield mark, at
            at += 2 + struct.unpack_from(">H", content, at + 2)[0]
            if mark == 0xDA:
                scan = _AFTER_A_SCAN.search(content, at)
                if scan is None:
                    raise UnsoundError("the JPEG is cut off; copy it again")
                at = scan.start()


def _bmp(content: bytes) -> Header:
    start, size = struct.unpack_from("<I", content, 10)[0], struct.unpack_from("<I", content, 14)[0]
    if size == 12:
        width, height, _, bits = struct.unpack_from("<HHHH", content, 18)
        compression = 0
    else:
        width, height, _, bits, compression = struct.unpack_from("<iiHHI", content, 18)
    if compression in (0, 3):
        row = (abs(width) * bits + 31) // 32 * 4
        if start + row * abs(height) > len(content):
            raise UnsoundError("the BMP is cut off; copy it again")
    return Header("BMP", width, abs(height), 8)


_TOKEN = re.compile(rb"(?:\s|#[^\n]*\n)*(\d{1,9})")


def _netpbm(content: bytes) -> Header:
    numbers, at = [], 2
    for _ in range(3):
        token = _TOKEN.match(content, at)
        if token is None:
            raise UnsoundError("the head of the PGM is damaged; copy it again")
        numbers.append(int(token[1]))
        at = token.end()
    width, height, highest = numbers
    if not 0 < highest < 65536:
        raise UnsoundError(f"the PGM says that white is {highest}; it must be from 1 to 65535")
    bits = 8 if highest < 256 else 16
    samples = width * height * (3 if content[1:2] in b"36" else 1)
    # One byte stands before binary samples; written out, each takes a space and a digit at least.
    smallest = samples * bits // 8 + 1 if content[1:2] in b"56" else 2 * samples
    if len(content) - at < smallest:
        raise UnsoundError("the PGM is cut off; copy it again")
    return Header("PGM", width, height, bits)


_WIDTH, _HEIGHT, _BITS, _SAMPLE_FORMAT = 256, 257, 258, 339
_SUBFILE, _OFFSETS, _COUNTS = 254, (273, 324), (279, 325)
_CODES = {1: "B", 3: "H", 4: "I", 16: "Q"}
_FLOAT, _SIGNED = 3, 2
MOST_PAGES = 10_000


def _tiff(content: bytes) -> Header:
    order = "<" if content[:2] == b"II" else ">"
    big = content[2:4] in (b"+\0", b"\0+")
    (at,) = struct.unpack_from(order + ("Q" if big else "I"), content, 8 if big else 4)
    pages = []
    visited: set[int] = set()
    while at:
        if at in visited or len(visited) > MOST_PAGES:
            raise UnsoundError("the TIFF is damaged (its pages run in a circle)")
        visited.add(at)
        tags, at = _tiff_page(content, at, order, big)
        if not tags.get(_SUBFILE, [0])[0] & 1:
            pages.append(tags)
    if len(pages) != 1:
        raise UnsoundError(
            f"this TIFF holds {len(pages)} images; save each of them as a file of its own"
        )
    tags = pages[0]
    bits, kind = set(tags.get(_BITS, [1])), tags.get(_SAMPLE_FORMAT, [1])[0]
    if kind in (_FLOAT, _SIGNED) or not (bits == {8} or bits == {16}):
        form = {_FLOAT: "floating-point ", _SIGNED: "signed "}.get(kind, "")
        raise UnsoundError(
            f"this TIFF has {form}samples of {max(bits)} bits; save it with 8 or 16 bits, unsigned"
        )
    offsets = [value for tag in _OFFSETS for value in tags.get(tag, [])]
    counts = [value for tag in _COUNTS for value in tags.get(tag, [])]
    if any(start + n > len(content) for start, n in zip(offsets, counts, strict=False)):
        raise UnsoundError("the TIFF is cut off; copy it again")
    if _WIDTH not in tags or _HEIGHT not in tags or not offsets:
        raise UnsoundError("the TIFF does not say its size; copy it again")
    return Header("TIFF", tags[_WIDTH][0], tags[_HEIGHT][0], max(bits))


def _tiff_page(content: bytes, at: int, order: str, big: bool) -> tuple[dict[int, list[int]], int]:
    """The whole-number tags of the page that begins at byte `at`, and where the next one begins."""
    word = "Q" if big else "I"
    head = struct.Struct(order + ("Q" if big else "H"))
    entry = struct.Struct(order + "HH" + word)
    room = struct.calcsize(order + word)
    (entries,) = head.unpack_from(content, at)
    at += head.size
    tags = {}
    if entries > 4096:
        raise UnsoundError("the TIFF is damaged; copy it again")
    for _ in range(entries):
        tag, kind, count = entry.unpack_from(content, at)
        if kind in _CODES:
            values = struct.Struct(f"{order}{min(count, len(content))}{_CODES[kind]}")
            place = at + entry.size
            if values.size > room:
                (place,) = struct.unpack_from(order + word, content, place)
            tags[tag] = list(values.unpack_from(content, place)) or [0]
        at += entry.size + room
    (following,) = struct.unpack_from(order + word, content, at)
    return tags, following
