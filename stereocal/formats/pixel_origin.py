"""Convert between pixel coordinates of other programs and ours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from stereocal.rig.compiled import FloatArray

Corner = Literal["upper-left", "lower-left"]
CORNERS: tuple[Corner, ...] = ("upper-left", "lower-left")
Flip = Literal["h", "h-1", "h+1"]
FLIPS: tuple[Flip, ...] = ("h", "h-1", "h+1")


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


LOWER_LEFT = PixelOrigin("lower-left")
