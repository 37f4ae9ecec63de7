"""Options of the exchange formats, and how numbers and text are read and written."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.lens_model import LensModel
from stereocal.formats.pixel_origin import PixelOrigin
from stereocal.formats.units import Unit
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.arrays import LARGEST
from stereocal.version import __version__

LARGEST_BYTES = 4_000_000
ImageSize = tuple[int, int]
ReadRig = tuple[Rig, Unit | None]
"""The rig in a file, and the unit of its lengths if stated."""
OUR_UNIT = "lengths in metres"
"""Text in all files that stereocal writes, except DLT coefficients."""


@dataclass(frozen=True)
class ExchangeOptions:
    """Settings that a format does not define."""

    image_sizes: tuple[ImageSize | None, ImageSize | None] = (None, None)
    """Of primary and secondary, if the file does not state them; reading only."""
    origin: PixelOrigin = field(default_factory=PixelOrigin)
    """Pixel origin of DLT coefficients."""
    world: Pose | None = None
    """`world_from_primary` of DLT coefficients; None: the primary's frame."""
    unit: Unit | None = None
    """Unit of the file's lengths; reading only."""
    lens_model: LensModel | None = None
    """Meaning of four coefficients if the file does not state it; reading only."""


def header(mark: str, *lines: str) -> str:
    """Comment lines that describe the file."""
    comments = [
        f"Written by stereocal {__version__}.",
        f"x_secondary = R x_primary + T; {OUR_UNIT}, image coordinates in pixels.",
        *lines,
    ]
    return "".join(f"{mark} {line}\n" for line in comments)


def number(value: float) -> str:
    """All digits of a float, with a point: YAML 1.1 reads `1e-05` as text."""
    text = repr(float(value))
    return text if "." in text or "e" not in text else text.replace("e", ".0e")


def numbers(values: FloatArray | Sequence[float]) -> str:
    """Numbers in brackets."""
    return "[" + ", ".join(number(value) for value in np.asarray(values).ravel()) + "]"


def refuse_skew(camera: Camera, which: str, where: str) -> None:
    """Raise a `StereocalError` if the skew is not 0."""
    if camera.K[0, 1] != 0:
        raise StereocalError(
            f"{where} does not support skew; that of the {which} camera is {camera.K[0, 1]:g} px."
        )


def camera_matrix(fx: float, fy: float, cx: float, cy: float) -> FloatArray:
    """K without skew."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def text_of(content: bytes, source: str) -> str:
    """The text of a file.

    Raises:
        StereocalError: empty, too large, or not text.
    """
    if not content.strip():
        raise StereocalError(f"{source}: the file is empty.")
    if len(content) > LARGEST_BYTES:
        raise StereocalError(f"{source}: {len(content)} bytes are too many for a parameter file.")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise StereocalError(f"{source}: this is not a text file (UTF-8).") from error


def array_of(value: Any, shape: tuple[int, ...], what: str, source: str) -> FloatArray:
    """Numbers from a file as an array of `shape`; -1 in it is any length.

    Raises:
        StereocalError: not numbers, not finite, too large, or another shape.
    """
    try:
        found = np.array(value, dtype=np.float64).reshape(shape)
    except (TypeError, ValueError, OverflowError) as error:
        size = "x".join("n" if side < 0 else str(side) for side in shape)
        raise StereocalError(f"{source}: {what} is not a table of {size} numbers.") from error
    if not np.isfinite(found).all():
        raise StereocalError(f"{source}: {what} has a number that is not finite.")
    if (np.abs(found) > LARGEST).any():
        raise StereocalError(f"{source}: {what} has a number that is too large.")
    return found


def size_of(value: Any, by_user: ImageSize | None, which: str, source: str) -> ImageSize:
    """The image size: the file's (`value`), or else the user's.

    Raises:
        StereocalError: there is neither, or they contradict each other.
    """
    if value is None:
        if by_user is None:
            raise StereocalError(
                f"{source}: the file does not state the image size of the {which} camera: state it."
            )
        return by_user
    width, height = (int(side) for side in array_of(value, (2,), "the image size", source))
    if by_user is not None and by_user != (width, height):
        raise StereocalError(
            f"{source}: the images of the {which} camera have {width}x{height} px in the file, "
            f"but {by_user[0]}x{by_user[1]} px were entered."
        )
    return width, height


def only_file(files: Mapping[str, bytes], ending: tuple[str, ...], source: str) -> tuple[str, str]:
    """Name and text of the only file, or of the only one with this ending.

    Raises:
        StereocalError: none, or several.
    """
    fitting = [name for name in files if name.lower().endswith(ending)] or list(files)
    if len(fitting) != 1:
        raise StereocalError(
            f"{source}: one file that ends with {' or '.join(ending)} is expected; there are "
            f"{len(fitting)}."
        )
    name = fitting[0]
    return name, text_of(files[name], name)
