"""Read a photograph as an array of grey values, exactly as the camera stored them."""

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

from stereocal.errors import StereocalError, disk_errors
from stereocal.system.limits import Limits

GreyImage = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]

SUFFIXES = frozenset((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".pnm"))
"""Endings of photographs' names; the format is determined from the content."""
SMALLEST_SIDE = 16
FORMATS = ("PNG", "JPEG", "TIFF", "BMP", "PPM")
CALLED = {"MPO": "JPEG", "PPM": "PGM"}
"""Pillow's MPO is a JPEG followed by previews, as some cameras write it."""
MAXIMUM_PAGES = 100
SUBFILE, BITS, SAMPLE_FORMAT = 254, 258, 339
"""Tags of a TIFF."""
AS_STORED = cv2.IMREAD_UNCHANGED | cv2.IMREAD_IGNORE_ORIENTATION
"""No rotation by EXIF, since the lens model is for unrotated pixels; 16 bits not reduced to 8."""

# Silence OpenCV: the errors below report the same with the file's name. OpenCV 4.9 has the function
# in another module and does not name the level.
if hasattr(cv2.utils, "logging"):
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
elif hasattr(cv2, "setLogLevel"):
    cv2.setLogLevel(0)
# The same for Pillow; `Limits` limits the number of pixels.
warnings.filterwarnings("ignore", module=r"PIL\.")
Image.MAX_IMAGE_PIXELS = None


class FileContent(Protocol):
    """A file that is read on demand: a path, or a file of a project."""

    @property
    def name(self) -> str:
        """For a file of a project, a digest of its content."""

    def read_bytes(self) -> bytes: ...

    def __hash__(self) -> int: ...


PhotographFile = FileContent | bytes
"""A file, or its content."""


def read_photograph(file: PhotographFile, name: str | None = None) -> GreyImage:
    """The photograph in a file: PNG, JPEG, TIFF, BMP or PGM, by content, not by name.

    Args:
        name: name in messages; None: the file's name.

    Returns:
        (h, w), uint8 or uint16: raw values, not rescaled for 10 or 12 bits in 16. Colours are
        converted to grey (ITU-R BT.601), transparency is dropped, EXIF orientation is ignored.
    """
    image = _decoded(file, name)
    if image.ndim == 3 and image.shape[2] == 2:
        image = image[:, :, 0]
    elif image.ndim == 3:
        image = cv2.cvtColor(np.ascontiguousarray(image[:, :, :3]), cv2.COLOR_BGR2GRAY)
    return np.ascontiguousarray(image)


def read_colours(file: PhotographFile, name: str | None = None) -> GreyImage:
    """The photograph in a file, (h, w, 3): blue, green, red, which are equal in a grey one."""
    image = _decoded(file, name)
    if image.ndim == 2 or image.shape[2] == 2:
        grey = image if image.ndim == 2 else image[:, :, 0]
        image = cv2.cvtColor(np.ascontiguousarray(grey), cv2.COLOR_GRAY2BGR)
    return np.ascontiguousarray(image[:, :, :3])


def _decoded(file: PhotographFile, name: str | None) -> npt.NDArray[Any]:
    """The photograph as stored."""
    content, name = _content_of(file, name)
    form, size = _header(content, name)
    if form == "PNG":
        content = _without_metadata(content)
    try:
        image: npt.NDArray[Any] | None = cv2.imdecode(np.frombuffer(content, np.uint8), AS_STORED)
    except cv2.error:
        image = None
    if image is None or image.size == 0:
        raise StereocalError(f"the {form} is cut off or damaged; copy it again.", name)
    if image.dtype not in (np.uint8, np.uint16) or image.shape[1::-1] != size:
        raise StereocalError(
            f"the {form} does not match its header ({size[0]}x{size[1]} px, 8 or 16 bits); copy "
            "it again.",
            name,
        )
    return image


def photograph_size(file: PhotographFile, name: str | None = None) -> tuple[int, int]:
    """(width, height) in pixels of the photograph in a file, without decoding it."""
    return _header(*_content_of(file, name))[1]


def _header(content: bytes, name: str) -> tuple[str, tuple[int, int]]:
    """Format, width and height from the header, checked before anything is decoded."""
    Limits.from_environment().check_size(len(content), name)
    if not content:
        raise StereocalError("the file is empty (0 bytes).", name)
    form = "file"
    try:
        image = Image.open(io.BytesIO(content), formats=FORMATS)
        form, size = CALLED.get(str(image.format), str(image.format)), image.size
        problem = _problem(image, content)
    except UnidentifiedImageError as error:
        raise StereocalError(
            "this is not a readable photograph (PNG, JPEG, TIFF, BMP or PGM of 8 or 16 bits), or "
            "it is cut off.",
            name,
        ) from error
    except Exception as error:  # Pillow's parsers may raise anything
        raise StereocalError(f"the {form} is cut off or damaged; copy it again.", name) from error
    Limits.from_environment().check_pixels(*size, name)
    if problem:
        raise StereocalError(f"{problem}.", name)
    if min(size) < SMALLEST_SIDE:
        raise StereocalError(f"{size[0]}x{size[1]} px are too few for a photograph.", name)
    return form, size


def _problem(image: Any, content: bytes) -> str:
    """Why an opened image is not a complete, supported photograph; empty if it is."""
    if image.format == "PNG":
        if image.is_animated:
            return "this is an animated PNG; save each of its images as a separate file"
        image.verify()  # the checksums, to the end of the file
    # Pillow has read up to the compressed image. OpenCV 4 silently decodes the missing part of a
    # truncated JPEG as grey.
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
    pages: Any = islice(ImageSequence.Iterator(image), MAXIMUM_PAGES)
    previews = [page.tag_v2.get(SUBFILE, 0) & 1 for page in pages]
    if previews[0] or previews.count(0) != 1:
        return "this TIFF contains several images; save each of them as a separate file"
    return ""


def _content_of(file: PhotographFile, name: str | None) -> tuple[bytes, str]:
    """The content, and the name in messages."""
    if isinstance(file, bytes):
        return file, name or "the photograph"
    name = name or file.name
    with disk_errors(f"{name} cannot be read"):
        if isinstance(file, Path):
            Limits.from_environment().check_size(file.stat().st_size, name)
        return file.read_bytes(), name


def _without_metadata(content: bytes) -> bytes:
    """The PNG without colour profile, EXIF and texts, which cause decoder warnings."""
    kept, start, kind = [content[:8]], 8, b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", content, start)
        end = start + 12 + length
        if kind[0] < ord("a"):
            kept.append(content[start:end])
        start = end
    return b"".join(kept)
