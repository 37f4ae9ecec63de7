"""A photograph as an array of grey values, exactly as the camera stored them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.system.limits import Limits
from stereocal.system.photograph_headers import (
    PNG_SIGNATURE,
    Header,
    UnsoundError,
    parse_header,
    png_chunks,
)

GreyImage = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".pnm"))
"""How the names of photographs end; what a file is, its content decides."""
SMALLEST_SIDE = 16
AS_STORED = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
"""No turn by EXIF, which would move the pixels away from the lens; 16 bits not cut to 8."""

# What OpenCV would write to the terminal is said in the errors below, with the file's name.
# 4.9 has the function at another place and does not name the level.
if hasattr(cv2.utils, "logging"):
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
elif hasattr(cv2, "setLogLevel"):
    cv2.setLogLevel(0)


class FileContent(Protocol):
    """A file that is read when its turn comes: a path, or one that a project holds."""

    @property
    def name(self) -> str:
        """Of a project's file, the same for the same content alone."""

    def read_bytes(self) -> bytes:
        """The content."""

    def __hash__(self) -> int: ...


def read_photograph(path: FileContent, name: str | None = None) -> GreyImage:
    """The photograph in a file: PNG, JPEG, TIFF, BMP or PGM, by its content, not by its name.

    Args:
        name: what messages call it, if not by the file's name.

    Returns:
        (h, w), uint8 or uint16: raw values, also those of 10 or 12 bits in 16. Colours are weighed
        to grey (ITU-R BT.601), transparency is dropped, the orientation in EXIF is not applied.

    Raises:
        StereocalError: it cannot be read, is no photograph, is cut off, or is too large.
    """
    name = name or path.name
    return decode_photograph(_content_of(path, name), name)


def decode_photograph(content: bytes, name: str) -> GreyImage:
    """As `read_photograph`, of a file's content; `name` is what messages call it."""
    Limits.from_environment().check_size(len(content), name)
    return decode_checked(content, read_header(content, name), name)


def decode_checked(content: bytes, header: Header, name: str) -> GreyImage:
    """As `decode_photograph`, of a file whose `read_header` is known."""
    if header.format == "PNG":
        content = _without_remarks(content)
    try:
        image: npt.NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), AS_STORED)
    except cv2.error:
        image = None
    if image is None or image.size == 0:
        raise StereocalError(f"{name}: the {header.format} is damaged; copy it again.")
    if image.ndim == 3 and image.shape[2] == 2:
        image = image[:, :, 0]
    elif image.ndim == 3:
        image = cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY)
    if image.dtype not in (np.uint8, np.uint16) or image.shape[::-1] != header.size:
        raise StereocalError(
            f"{name}: the {header.format} does not hold what its head says "
            f"({header.width}x{header.height} px); copy it again."
        )
    return np.ascontiguousarray(image)


def photograph_header(path: FileContent, name: str | None = None) -> Header:
    """Format and size of the photograph in a file, which is looked through and not decoded.

    Raises:
        StereocalError: as `read_photograph`.
    """
    name = name or path.name
    return read_header(_content_of(path, name), name)


def read_header(content: bytes, name: str) -> Header:
    """As `photograph_header`, of a file's content."""
    try:
        header = parse_header(content)
    except UnsoundError as error:
        raise StereocalError(f"{name}: {error}.") from error
    Limits.from_environment().check_pixels(header.width, header.height, name)
    if min(header.size) < SMALLEST_SIDE:
        raise StereocalError(
            f"{name}: {header.width}x{header.height} px are too few for a photograph."
        )
    return header


def _content_of(path: FileContent, name: str) -> bytes:
    try:
        if isinstance(path, Path):
            Limits.from_environment().check_size(path.stat().st_size, name)
        return path.read_bytes()
    except OSError as error:
        raise StereocalError(f"{name} cannot be read: {error.strerror or error}.") from error


def _without_remarks(content: bytes) -> bytes:
    """The PNG without colour profile, EXIF and texts, of which the decoder would complain."""
    kept = [content[at:end] for kind, at, end in png_chunks(content) if kind[0] < ord("a")]
    return PNG_SIGNATURE + b"".join(kept)
