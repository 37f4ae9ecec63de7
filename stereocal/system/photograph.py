"""A photograph as an array of grey values, exactly as the camera stored them."""

from __future__ import annotations

import io
import struct
import warnings
from itertools import islice
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageSequence, UnidentifiedImageError

from stereocal.errors import StereocalError
from stereocal.system.limits import Limits

GreyImage = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".pnm"))
"""How the names of photographs end; what a file is, its content decides."""
SMALLEST_SIDE = 16
FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM")
CALLED = {"MPO": "JPEG", "PPM": "PGM"}
"""Pillow's name MPO stands for a JPEG with previews after it, as some cameras write it."""
MOST_PAGES = 100
SUBFILE, BITS, SAMPLE_FORMAT = 254, 258, 339
"""Tags of a TIFF."""
AS_STORED = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
"""No turn by EXIF, which would move the pixels away from the lens; 16 bits not cut to 8."""

# What OpenCV would write to the terminal is said in the errors below, with the file's name.
# 4.9 has the function at another place and does not name the level.
if hasattr(cv2.utils, "logging"):
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
elif hasattr(cv2, "setLogLevel"):
    cv2.setLogLevel(0)
# The same for Pillow; how many pixels are too many, `Limits` decides.
warnings.filterwarnings("ignore", module=r"PIL\.")
Image.MAX_IMAGE_PIXELS = None


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
    form, size = _look(content, name)
    if form == "PNG":
        content = _without_remarks(content)
    try:
        image: npt.NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), AS_STORED)
    except cv2.error:
        image = None
    if image is None or image.size == 0:
        raise StereocalError(f"{name}: the {form} is cut off or damaged; copy it again.")
    if image.ndim == 3 and image.shape[2] == 2:
        image = image[:, :, 0]
    elif image.ndim == 3:
        image = cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY)
    if image.dtype not in (np.uint8, np.uint16) or image.shape[::-1] != size:
        raise StereocalError(
            f"{name}: the {form} does not hold what its head says ({size[0]}x{size[1]} px, 8 or "
            "16 bits); copy it again."
        )
    return np.ascontiguousarray(image)


def photograph_size(path: FileContent, name: str | None = None) -> tuple[int, int]:
    """(width, height) in pixels of the photograph in a file, which is not decoded.

    Raises:
        StereocalError: as `read_photograph`, but damage inside the image is not seen.
    """
    name = name or path.name
    return _look(_content_of(path, name), name)[1]


def _look(content: bytes, name: str) -> tuple[str, tuple[int, int]]:
    """Format, width and height, before anything is decoded: a decoder believes what a head says."""
    Limits.from_environment().check_size(len(content), name)
    if not content:
        raise StereocalError(f"{name}: the file is empty (0 bytes).")
    form = "file"
    try:
        image = Image.open(io.BytesIO(content), formats=FORMATS)
        form, size = CALLED.get(str(image.format), str(image.format)), image.size
        problem = _problem(image, content)
    except UnidentifiedImageError as error:
        raise StereocalError(
            f"{name}: this is no photograph that can be read (PNG, JPEG, TIFF, BMP or PGM of 8 or "
            "16 bits), whatever its name, or it is cut off."
        ) from error
    except Exception as error:  # whatever Pillow's parsers run into
        raise StereocalError(f"{name}: the {form} is cut off or damaged; copy it again.") from error
    Limits.from_environment().check_pixels(*size, name)
    if problem:
        raise StereocalError(f"{name}: {problem}.")
    if min(size) < SMALLEST_SIDE:
        raise StereocalError(f"{name}: {size[0]}x{size[1]} px are too few for a photograph.")
    return form, size


def _problem(image: Any, content: bytes) -> str:
    """Why an opened image is not a whole photograph that can be read; empty if it is."""
    if image.format == "PNG":
        if image.is_animated:
            return "this is an animated PNG; save each of its images as a file of its own"
        image.verify()  # the checksums, to the end of the file
    # Pillow has read to where the compressed image begins. OpenCV 4 decodes the rest of a JPEG
    # that is cut off as grey, without a word.
    elif image.format in ("JPEG", "MPO") and content.find(b"\xff\xd9", image.fp.tell()) < 0:
        return "the JPEG is cut off; copy it again"
    elif image.format == "TIFF":
        return _tiff_problem(image)
    return ""


def _tiff_problem(image: Any) -> str:
    bits, kind = set(image.tag_v2.get(BITS, (1,))), set(image.tag_v2.get(SAMPLE_FORMAT, (1,)))
    if kind != {1} or bits not in ({8}, {16}):
        form = {(2,): "signed ", (3,): "floating-point "}.get(tuple(kind), "")
        return (
            f"this TIFF has {form}samples of {max(bits)} bits; save it with 8 or 16 bits, unsigned"
        )
    pages: Any = islice(ImageSequence.Iterator(image), MOST_PAGES)
    previews = [page.tag_v2.get(SUBFILE, 0) & 1 for page in pages]
    if previews[0] or previews.count(0) != 1:
        return "this TIFF holds several images; save each of them as a file of its own"
    return ""


def _content_of(path: FileContent, name: str) -> bytes:
    try:
        if isinstance(path, Path):
            Limits.from_environment().check_size(path.stat().st_size, name)
        return path.read_bytes()
    except OSError as error:
        raise StereocalError(f"{name} cannot be read: {error.strerror or error}.") from error


def _without_remarks(content: bytes) -> bytes:
    """A whole PNG without colour profile, EXIF and texts, of which the decoder would complain."""
    kept, at, kind = [content[:8]], 8, b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", content, at)
        end = at + 12 + length
        if kind[0] < ord("a"):
            kept.append(content[at:end])
        at = end
    return b"".join(kept)
