"""A photograph as the fits take it: 32-bit floats, the brightest parts at 255."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereocal.detection.edges import GreyImage
from stereocal.errors import StereocalError

LIGHT = 255.0
"""Photographs are scaled so that their brightest parts have this grey level."""


@dataclass(frozen=True, eq=False)
class Light:
    """A photograph as the fits take it."""

    image: GreyImage
    gain: float
    quantum: float
    """Step of the numbers in `image`; 0 for a photograph of floating-point numbers."""
    full: float
    """Grey level of the photograph that means saturated; infinite where that is not known."""
    saturated: float
    """Share of the pixels at that level."""


def prepare(image: npt.NDArray[Any]) -> Light:
    """Brightness as 32-bit floats, scaled so that the brightest parts are at 255."""
    if image.ndim != 2 or not image.size:
        raise StereocalError(
            f"A photograph must be a grey image (height, width), not an array {image.shape}."
        )
    if image.dtype.kind not in "uif":
        raise StereocalError(f"A photograph must hold numbers, not {image.dtype}.")
    few = image[:: max(1, image.shape[0] // 256), :: max(1, image.shape[1] // 256)]
    bright = float(np.percentile(few, 99.9))
    if image.dtype.kind == "f" and not np.isfinite(image).all():
        raise StereocalError("The photograph has pixels that are not finite numbers.")
    gain = LIGHT / bright if bright > 0 else 1.0
    if image.dtype == np.uint8:
        gain = max(1.0, gain) if bright < 0.5 * LIGHT else 1.0
    scaled = np.ascontiguousarray(image, dtype=np.float32)
    if gain != 1.0:
        scaled = scaled * np.float32(gain)
    full = math.inf
    if image.dtype.kind in "ui":
        highest = int(image.max())
        full = float(next((2**b - 1 for b in (8, 10, 12, 14, 16) if highest < 2**b), highest))
    quantum = gain if image.dtype.kind in "ui" else 0.0
    return Light(scaled, gain, quantum, full, float(np.mean(few >= full)))
