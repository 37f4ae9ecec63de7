"""What files of other programs may not say: the user's statements, as page and command line ask."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.rig.camera import LensModel
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import POSSIBLE_PX

Unit = Literal["m", "cm", "mm", "inch", "feet"]
UNITS: Mapping[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "inch": 0.0254, "feet": 0.3048}
"""Metres per unit."""
_UNIT_WORDS: Mapping[str, Unit] = {
    **dict.fromkeys(("m", "meter", "metre"), "m"),
    **dict.fromkeys(("cm", "centimeter", "centimetre"), "cm"),
    **dict.fromkeys(("mm", "millimeter", "millimetre"), "mm"),
    **dict.fromkeys(("in", "inch", "inche", '"'), "inch"),
    **dict.fromkeys(("ft", "foot", "feet"), "feet"),
}
"""By their names in lower case, without a plural s."""
POSSIBLE_M = (0.002, 100.0)
"""Plausible baselines: stereo laparoscopes have 4 mm; the largest still allow a portable bar."""
USUAL_M = (0.01, 10.0)
"""Plausible baselines if metres are assumed: narrow, so that 1 cm to 10 m in mm, or 10 cm
to 10 m in cm, are not taken for metres."""
Corner = Literal["upper-left", "lower-left"]
CORNERS: tuple[Corner, ...] = ("upper-left", "lower-left")
Flip = Literal["h", "h-1", "h+1"]
FLIPS: tuple[Flip, ...] = ("h", "h-1", "h+1")
Frames = Literal["common", "own"]
ImageSize = tuple[int, int]
Contents = Mapping[str, bytes]
"""Files by name."""


@dataclass(frozen=True)
class PixelOrigin:
    """The pixel coordinates (u', v') of another program.

    `u' = u + first_pixel`. Upper left: `v' = v + first_pixel`. Lower left: `v' = flip - v`, where h
    is the image height. (u, v) are stereocal's: (0, 0) is the centre of the top-left pixel.
    """

    corner: Corner = "upper-left"
    first_pixel: float = 0.0
    """Coordinate of the centre of the first pixel: 1 in MATLAB, 0.5 in COLMAP."""
    flip: Flip = "h"
    """DLTdv5 to 7, Argus and easyWand use h; others h - 1 (the bottom row is 0) or h + 1."""

    def matrix(self, height: int) -> FloatArray:
        """(3, 3): transforms our homogeneous pixels to theirs."""
        if self.corner == "upper-left":
            return np.array([[1.0, 0, self.first_pixel], [0, 1.0, self.first_pixel], [0, 0, 1.0]])
        flip = height + {"h": 0, "h-1": -1, "h+1": 1}[self.flip]
        return np.array([[1.0, 0, self.first_pixel], [0, -1.0, flip], [0, 0, 1.0]])

    def to_ours(self, pixels: npt.ArrayLike, height: int) -> FloatArray:
        """Convert their pixels (n, 2) to ours."""
        matrix = np.linalg.inv(self.matrix(height))
        return np.asarray(np.asarray(pixels, np.float64) @ matrix[:2, :2].T + matrix[:2, 2])


USUAL_ORIGIN = PixelOrigin()
LOWER_LEFT = PixelOrigin("lower-left")


@dataclass(frozen=True)
class ExchangeOptions:
    """What the user states about files of another program; None: as the file or program does."""

    image_sizes: tuple[ImageSize | None, ImageSize | None] = (None, None)
    """Width and height, primary first."""
    cameras: tuple[str | int, str | int] | None = None
    """Primary and secondary, by name or number (from 1), or by index; None: the first two."""
    in_order: bool = True
    """Whether files of one camera each are given as primary and secondary; in a folder they are
    not."""
    unit: Unit | None = None
    """Unit of the lengths in the files; reading only."""
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
    roles: str | None = None
    """What each column of the table holds, as of `column_roles`; None: as its header says."""
    frames: Frames | None = None
    """Whether the cameras of a table have one count of frames, or each its own since they were
    started by hand; None: own where the table calls it `camera_frame`."""
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
    between: tuple[float, float] = (-POSSIBLE_PX[1], POSSIBLE_PX[1])
    """Bounds of a number."""


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
    "frames": Question(
        "--frames",
        "The cameras were",
        "own: the cameras were started by hand, and each counts its own frames; common: frame 12 "
        "of all is one moment (default: own of a column camera_frame, else common, unless the "
        "points contradict that)",
        {
            "common": "in step: frame 12 of all is one moment",
            "own": "started by hand: each counts its own frames",
        },
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


def unit_called(word: str) -> Unit | None:
    """The unit that a word of a file names; None if none is known by it."""
    return _UNIT_WORDS.get(word.strip().lower().removesuffix("s"))


class UnitError(StereocalError):
    """Lengths of unknown unit, or implausible in the stated unit."""

    def __init__(self, what: str, baseline: float) -> None:
        low, high = POSSIBLE_M
        fitting = {
            unit: f"{unit} ({baseline * scale:g} m)"
            for unit, scale in UNITS.items()
            if low <= baseline * scale <= high
        }
        none = f"{', '.join(UNITS)}; none of them is plausible"
        choice = " or ".join(fitting.values()) or none
        self.question = f"{what}: state the unit of its lengths, {choice}."
        super().__init__(self.question, option=f"--unit {' or '.join(fitting or UNITS)}")


class OriginError(StereocalError):
    """DLT coefficients whose pixel origin seems to be another than is usual."""

    def __init__(self, source: str) -> None:
        corner_unstated = (
            f"{source}: the coefficients seem to be counted from the lower left, as those of "
            "easyWand, Argus and DLTdv5 to 7; or else the world's origin lies behind the cameras."
        )
        self.question = f"{corner_unstated} Where are they counted from?"
        option = "--image-origin lower-left; or, if the world's origin lies there, upper-left"
        super().__init__(self.question, option=option)


def metres_per_unit(
    baseline: float, stated: Unit | None, by_user: Unit | None, usual: Unit | None, source: str
) -> float:
    """Factor that converts the lengths of a file to metres.

    Args:
        baseline: distance of the two cameras, in the file's unit.
        stated: the unit stated in the file.
        by_user: the unit stated by the user.
        usual: the unit of all files of this format, by its documentation.

    Raises:
        UnitError: the unit is unknown, or the baseline is implausible.
        StereocalError: file and user contradict each other.
    """
    if by_user and stated and by_user != stated:
        raise StereocalError(
            f"{source}: the file's lengths are in {stated}, but the unit entered is {by_user}."
        )
    unit = by_user or stated or usual
    if unit is None:
        raise UnitError(
            f"{source}: the file does not say the unit of its baseline, {baseline:g}", baseline
        )
    low, high = POSSIBLE_M if by_user or stated else USUAL_M
    if not low <= baseline * UNITS[unit] <= high:
        raise UnitError(
            f"{source}: a baseline of {baseline:g} {unit} is not plausible (expected {low:g} to "
            f"{high:g} m)",
            baseline,
        )
    return UNITS[unit]
