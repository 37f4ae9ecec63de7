"""Normalise the intensity of a photograph: 32-bit floats, brightest parts at 255."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from stereocal.detection.edges import GreyImage
from stereocal.errors import StereocalError

BRIGHTEST = 255.0
"""Photographs are scaled so that their brightest parts have this grey level."""


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
