"""Which lens the coefficients of a file belong to: OpenCV's usual one, or its fisheye.

Both have four, k1 k2 p1 p2 and k1 k2 k3 k4, and mean another lens. Where the file does not say
which, a person must.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.compiled import FloatArray

LensModel = Literal["brown", "fisheye"]
LENS_MODELS: tuple[LensModel, ...] = ("brown", "fisheye")
USUAL = ("brown", "plumb_bob", "radtan", "rational_polynomial", "pinhole", "opencv")
FISHEYE = ("fisheye", "equidistant", "equi", "kannala_brandt", "kannala_brandt4", "kb4")


class FourCoefficientsError(StereocalError):
    """A lens with four coefficients of which nobody has said what they are."""

    def __init__(self, source: str) -> None:
        self.question = (
            f"{source}: the lens has 4 distortion coefficients, and the file does not say whether "
            "they are k1 k2 p1 p2 (OpenCV's usual lens) or k1 k2 k3 k4 (its fisheye, which "
            "stereocal does not know)."
        )
        super().__init__(
            f"{self.question} For the usual lens, say --lens-model brown, or write "
            "distortion_model: plumb_bob into the file."
        )


def fisheye_refused(source: str) -> StereocalError:
    """What to do with a fisheye."""
    return StereocalError(
        f"{source}: the lens is a fisheye (k1 k2 k3 k4), which stereocal does not know. "
        "Calibrate it as a usual lens (OpenCV's calibrateCamera, or the page Cameras), or "
        "undistort the images first and give the camera without distortion."
    )


def five_or_more(coefficients: FloatArray) -> FloatArray:
    """The coefficients of a usual lens so that no program takes them for a fisheye's: k3 = 0."""
    return np.append(coefficients, np.zeros(max(5 - coefficients.size, 0)))


def check_lens_model(
    coefficients: FloatArray, stated: object, given: LensModel | None, source: str
) -> None:
    """Refuse a fisheye, and four coefficients that may be one.

    Args:
        stated: the file's name of its lens model, or whether it is a fisheye; None where it does
            not say.
        given: what a person says.

    Raises:
        FourCoefficientsError: they may be either, and nobody says which.
        StereocalError: they are a fisheye's.
    """
    name = str(stated).strip().lower() if isinstance(stated, str) else ""
    if given == "fisheye" or name in FISHEYE or stated is True:
        raise fisheye_refused(source)
    settled = given == "brown" or name in USUAL or stated is False
    if coefficients.size == 4 and coefficients.any() and not settled:
        raise FourCoefficientsError(source)
