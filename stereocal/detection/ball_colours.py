"""Which pixels of a photograph have the colour of a ball."""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from PIL import ImageColor

from stereocal.detection.target import BRIGHT, Balls
from stereocal.errors import StereocalError
from stereocal.fit.screening.outliers import MAD_TO_SIGMA
from stereocal.rig.compiled import compiled
from stereocal.system.array_types import FloatArray

Colours = npt.NDArray[np.uint8]
"""(h, w, 3): blue, green, red."""
NAMED, MEASURED = (25.0, 0.3), (15.0, 0.6)
"""Largest difference of hue, degrees, and least part of the target's saturation: for a pure colour,
which is a name, and for one taken from a photograph."""
LEAST_CHROMA = 10.0
"""Grey levels; less is noise or a dark grey."""
OVER_BACKGROUND = 6.0
"""Robust standard deviations of the photograph's chroma in the same direction."""
GREY_CHROMA = 0.12
"""Targets with less chroma over intensity are found by their intensity."""


def colour_at(image: npt.NDArray[Any], point: tuple[float, float]) -> str:
    """The colour of a ball where a person clicked, as `Balls` has it; `white` for a grey."""
    colours = colours_in_eight_bits(image)
    u, v = (round(coordinate) for coordinate in point)
    around = colours[max(0, v - 2) : v + 3, max(0, u - 2) : u + 3].reshape(-1, 3)
    if not len(around):
        raise StereocalError("The click is outside the photograph.")
    blue, green, red = (int(level) for level in np.median(around, axis=0))
    if max(blue, green, red) - min(blue, green, red) < LEAST_CHROMA:
        return "white"
    return f"#{red:02x}{green:02x}{blue:02x}"


def colours_in_eight_bits(image: npt.NDArray[Any]) -> Colours:
    """The photograph (h, w, 3) with 8 bits, the brightest value at 255 if it had more."""
    if image.dtype == np.uint8:
        return image
    gain = 255.0 / max(1.0, float(image.max()))
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)


def _bgr(colour: str) -> FloatArray:
    """(3,): blue, green and red of a name or `#rrggbb`, 0 to 255."""
    return np.array(ImageColor.getrgb(colour)[2::-1], dtype=np.float64)


def masks(image: npt.NDArray[Any], target: Balls) -> list[npt.NDArray[np.uint8]]:
    """For each target, one for balls of one colour, (h, w): 1 where the photograph (h, w, 3) of
    8 bits has its colour."""
    by_colour = []
    for colour in dict.fromkeys(target.colours):
        sampled = image[::8, ::8].astype(np.float64)  # enough for a median
        rule = _rule(sampled, colour, target)
        if rule is None:
            grey: npt.NDArray[np.uint8] = np.asarray(image.max(axis=2), np.uint8)
            dark = colour != BRIGHT and _bgr(colour).mean() < 127
            mask = _brighter(np.asarray(~grey if dark else grey, np.uint8))
        else:
            mask = np.zeros(image.shape[:2], np.uint8)
            _fill_mask(image, *rule, mask)
        by_colour.append(mask)
    return by_colour


class _Rule(NamedTuple):
    """When a pixel p, (3,) in grey levels of blue, green and red, has a colour."""

    axes: FloatArray
    """(2, 3): unit vectors along the colour's chroma and across it; both are normal to grey."""
    least: float
    """p . along is above this, in grey levels."""
    slack: float
    """|p . across| is below this part of p . along: the tangent of the difference of hue."""
    saturation: float
    """p . along is above this part of |p|."""


def _rule(sampled: FloatArray, colour: str, target: Balls) -> _Rule | None:
    """The rule for a colour of the target in a photograph; None for a grey.

    Args:
        sampled: (h, w, 3), some pixels of the photograph.
    """
    if colour == BRIGHT or (chroma := _chroma(colour)) is None:
        return None
    size = float(np.linalg.norm(chroma))
    along = chroma / size
    across = np.cross(along, np.ones(3) / math.sqrt(3.0))
    is_pure = _bgr(colour).min() == 0
    degrees, least_part = NAMED if is_pure else MEASURED
    largest_angle = math.radians(degrees)
    for other in target.colours:
        if other not in (colour, BRIGHT) and (of_other := _chroma(other)) is not None:
            between = abs(math.atan2(float(across @ of_other), float(along @ of_other)))
            largest_angle = min(largest_angle, 0.5 * between)  # half way to its hue
    signal = sampled @ along
    background = float(np.median(signal))
    spread = MAD_TO_SIGMA * float(np.median(np.abs(signal - background)))
    least = max(LEAST_CHROMA, background + OVER_BACKGROUND * spread)
    saturation = least_part * size / float(np.linalg.norm(_bgr(colour)))
    return _Rule(np.array([along, across]), least, math.tan(largest_angle), saturation)


def _chroma(colour: str) -> FloatArray | None:
    """(3,): blue, green and red of a colour less their mean, in grey levels; None for a grey."""
    whole = _bgr(colour)
    chroma = whole - whole.mean()
    is_grey = np.linalg.norm(chroma) < GREY_CHROMA * np.linalg.norm(whole)
    return None if is_grey or not whole.any() else chroma


@compiled
def _fill_mask(
    image: npt.NDArray[np.uint8],
    axes: FloatArray,
    least: float,
    slack: float,
    saturation: float,
    mask: npt.NDArray[np.uint8],
) -> None:
    """Write 1 to the mask (h, w) where a pixel of the image (h, w, 3) fits a `_Rule`."""
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            b, g, r = float(image[y, x, 0]), float(image[y, x, 1]), float(image[y, x, 2])
            signal = axes[0, 0] * b + axes[0, 1] * g + axes[0, 2] * r
            if signal > least:
                side = axes[1, 0] * b + axes[1, 1] * g + axes[1, 2] * r
                if abs(side) < slack * signal:
                    squared = saturation * saturation * (b * b + g * g + r * r)
                    mask[y, x] = signal * signal > squared


def _brighter(grey: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    """(h, w): 1 above the middle between background and brightest."""
    sampled = grey[::4, ::4]
    background, top = float(np.median(sampled)), float(grey.max())
    spread = MAD_TO_SIGMA * float(np.median(np.abs(sampled - background)))
    middle = background + 0.5 * (top - background)
    least = max(middle, background + OVER_BACKGROUND * spread + 2.0)  # 2: if nothing scatters
    return (grey > least).astype(np.uint8)
