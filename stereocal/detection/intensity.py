"""Grey levels of a photograph: to 8 bits, normalised, and along the normals of a curve."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from stereocal.errors import StereocalError
from stereocal.system.array_types import FloatArray

GreyImage = npt.NDArray[np.float32]
BRIGHTEST = 255.0
"""Photographs are scaled so that their brightest parts have this grey level."""
STEP = 0.5
"""px between the samples of a profile."""


@dataclass(frozen=True, eq=False)
class Intensity:
    """A photograph with normalised intensity."""

    image: GreyImage
    gain: float
    """Factor from grey levels of the photograph to those of `image`."""
    quantum: float
    """Quantisation step in `image`; 0 for a floating-point photograph."""
    full: float
    """Saturated grey level of the photograph; infinite if unknown."""
    saturated: float
    """Share of the saturated pixels."""


def eight_bits(image: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """The photograph with 8 bits; 10, 12 or 16 bits are scaled to the full range."""
    if image.dtype == np.uint8:
        return image
    low, high = np.percentile(image[::4, ::4], (0.5, 99.5))
    stretched = (image.astype(np.float32) - low) * (255.0 / max(high - low, 1.0))
    return np.asarray(np.clip(stretched, 0, 255), dtype=np.uint8)


def normalise_intensity(image: npt.NDArray[Any]) -> Intensity:
    """Convert a photograph (height, width) to 32-bit floats with the brightest parts at 255."""
    if image.ndim != 2 or not image.size:
        raise StereocalError(
            f"A photograph must be a grey image (height, width), not an array {image.shape}."
        )
    if image.dtype.kind not in "uif":
        raise StereocalError(f"A photograph must be an array of numbers, not {image.dtype}.")
    few = image[:: max(1, image.shape[0] // 256), :: max(1, image.shape[1] // 256)]
    bright = float(np.percentile(few, 99.9))
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        raise StereocalError("The photograph has pixels that are not finite numbers.")
    gain = BRIGHTEST / bright if bright > 0 else 1.0
    if image.dtype == np.uint8:
        gain = max(1.0, gain) if bright < 0.5 * BRIGHTEST else 1.0
    scaled = np.ascontiguousarray(image, dtype=np.float32)
    if gain != 1.0:
        scaled = scaled * np.float32(gain)
    full = math.inf
    if image.dtype.kind in "ui":
        highest = int(image.max())
        full = float(next((2**b - 1 for b in (8, 10, 12, 14, 16) if highest < 2**b), highest))
    quantum = gain if image.dtype.kind in "ui" else 0.0
    return Intensity(scaled, gain, quantum, full, float(np.mean(few >= full)))


def profiles(
    image: npt.NDArray[Any], points: FloatArray, normals: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Intensities along the normals.

    Args:
        image: (h, w), grey levels.
        points, normals: (n, 2): px, and unit vectors that point outside.
        reach: how far the profiles extend to both sides, px.

    Returns:
        (m,): distances along the normal, px; and (n, m), NaN for profiles that leave the image.
    """
    along = np.arange(-reach, reach + 0.5 * STEP, STEP)
    u = points[:, :1] + along * normals[:, :1]
    v = points[:, 1:] + along * normals[:, 1:]
    intensities = map_coordinates(image, [v, u], np.float64, order=1, mode="nearest")
    height, width = image.shape
    outside = (np.minimum(u, v) < 0) | (u > width - 1) | (v > height - 1)
    intensities[outside.any(axis=1)] = np.nan
    return along, intensities


def steepest(
    along: FloatArray, profile: FloatArray, width: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where each profile of `profiles` falls most steeply, from inside to outside.

    The position is the centroid of the descent around its steepest part, in a window of half this
    width in px: without bias for any symmetric blur.

    Returns:
        (n,), NaN where unknown: offset along the normal in px, the height of the edge in grey
        levels, and its variance in px^2.
    """
    fall = profile[:, :-1] - profile[:, 1:]
    middle = 0.5 * (along[1:] + along[:-1])
    smooth = fall.copy()
    smooth[:, 1:-1] += 0.5 * (fall[:, :-2] + fall[:, 2:])
    known = np.isfinite(fall).all(axis=1)
    peak = np.where(known, middle[np.argmax(np.nan_to_num(smooth), axis=1)], np.nan)
    for _ in range(2):
        near = np.clip(1.0 + width - np.abs(middle - peak[:, None]), 0.0, 1.0)
        weight = near * np.maximum(fall, 0.0)
        total = weight.sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            peak = np.where(total > 0, (weight * middle).sum(axis=1) / total, np.nan)
            variance = (weight * (middle - peak[:, None]) ** 2).sum(axis=1) / total
    return peak, total, variance
