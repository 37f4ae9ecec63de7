"""What the user states about files of other programs, and how numbers and text are written."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.pixel_origin import Corner, Flip, PixelOrigin
from stereocal.formats.units import Unit
from stereocal.rig.camera import Camera, LensModel
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.version import __version__

ImageSize = tuple[int, int]
Posed = tuple[str, Camera, Pose]
"""A camera's name, lens, and pose from the first camera."""
OUR_UNIT = "lengths in metres"
"""Text in all files that stereocal writes, except DLT coefficients."""
USUAL_ORIGIN = PixelOrigin()


@dataclass(frozen=True)
class ExchangeOptions:
    """What the user states about files of another program; None: as the file or program does."""

    image_sizes: tuple[ImageSize | None, ImageSize | None] = (None, None)
    """Of primary and secondary."""
    cameras: tuple[str, str] | None = None
    """Primary and secondary, by number (from 1) or name; None: the first two."""
    unit: Unit | None = None
    """Of the lengths in the files; reading only."""
    lens_model: LensModel | None = None
    """Meaning of four coefficients if the file does not state it."""
    corner: Corner | None = None
    first_pixel: float | None = None
    flip: Flip | None = None
    """Pixel origin of points and DLT coefficients, as in `PixelOrigin`."""
    ends: tuple[str, str] | None = None
    """Names of the points A and B of the bar in a table; None: the first two."""
    layout: str | None = None
    """Layout of a table of points, by name; None: recognised."""
    world: Pose | None = None
    """`world_from_primary` of DLT coefficients; None: the primary's frame. Writing only."""

    def origin(self, usual: PixelOrigin = USUAL_ORIGIN) -> PixelOrigin:
        """The pixel origin; `usual` is that of the program."""
        return PixelOrigin(
            self.corner or usual.corner,
            usual.first_pixel if self.first_pixel is None else self.first_pixel,
            self.flip or usual.flip,
        )


def posed(rig: Rig) -> tuple[Posed, Posed]:
    """Two cameras, with their poses from the primary."""
    still = Pose(np.eye(3), np.zeros(3))
    return ("primary", rig.primary, still), ("secondary", rig.secondary, rig.pose)


def rig_of(two: Sequence[Posed]) -> Rig:
    """The inverse of `posed`."""
    (_, primary, _), (_, secondary, pose) = two
    return Rig(primary, secondary, pose)


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
