"""What files of other programs may not say: the user's statements, as page and command line ask."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from stereocal.formats.pixel_origin import CORNERS, FLIPS, Corner, Flip, PixelOrigin
from stereocal.formats.units import UNITS, Unit
from stereocal.rig.camera import LensModel
from stereocal.rig.geometry import Pose

ImageSize = tuple[int, int]
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


@dataclass(frozen=True)
class Question:
    """A question, whose answer is a field of `ExchangeOptions`; None: as file or program say."""

    option: str
    """On the command line."""
    title: str
    """On the page."""
    help: str
    choices: Mapping[str, str] = field(default_factory=dict)
    """Answers and their words on the page; empty: a number."""


QUESTIONS: Mapping[str, Question] = {
    "unit": Question(
        "--unit",
        "Its lengths are in",
        "unit of the lengths in the files, if they do not state it",
        {unit: unit for unit in UNITS},
    ),
    "lens_model": Question(
        "--lens-model",
        "Four distortion coefficients are",
        "the model of four distortion coefficients, if the file does not state it: brown is "
        "OpenCV's usual k1 k2 p1 p2, fisheye its k1 k2 k3 k4",
        {"brown": "k1 k2 p1 p2: the usual lens", "fisheye": "k1 k2 k3 k4: a fisheye"},
    ),
    "corner": Question(
        "--image-origin",
        "Points are counted from the",
        "origin of points and DLT coefficients (default: the program's, or upper-left). Lower "
        "left: DLTdv5 to 7, Argus, easyWand. Upper left: DLTdv8",
        {corner: corner.replace("-", " ") for corner in CORNERS},
    ),
    "first_pixel": Question(
        "--first-pixel",
        "The first pixel's centre is at",
        "coordinate of the first pixel's centre: 0 here and in OpenCV, 1 in MATLAB and DLTdv, 0.5 "
        "in COLMAP",
    ),
    "flip": Question(
        "--flip",
        "Height h counts as",
        "lower left: v' = this minus v, with the image height h (most programs: h)",
        dict(zip(FLIPS, ("h − v (most programs)", "h − 1 − v", "h + 1 − v"), strict=True)),
    ),
}
ORIGIN = ("corner", "first_pixel", "flip")
