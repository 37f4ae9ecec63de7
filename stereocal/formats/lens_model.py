"""Distinguish OpenCV's standard lens model (k1 k2 p1 p2) from its fisheye model (k1 k2 k3 k4).

Both may have four coefficients; if the file does not state the model, the user must.
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
    """A lens with four coefficients whose model is not stated."""

    def __init__(self, source: str) -> None:
        self.question = (
            f"{source}: the lens has 4 distortion coefficients, and the file does not say whether "
            "they are k1 k2 p1 p2 (OpenCV's usual lens) or k1 k2 k3 k4 (its fisheye, which "
            "stereocal does not support)."
        )
        super().__init__(
            f"{self.question} For the usual lens, use --lens-model brown, or write "
            "distortion_model: plumb_bob into the file."
        )


def fisheye_refused(source: str) -> StereocalError:
    return StereocalError(
        f"{source}: the lens is a fisheye (k1 k2 k3 k4), which stereocal does not support. "
        "Calibrate it as a usual lens (OpenCV's calibrateCamera, or the page Lenses), or "
        "undistort the images first and use a camera without distortion."
    )


def five_or_more(coefficients: FloatArray) -> FloatArray:
    """The coefficients with at least k3 = 0 appended, so that they do not look like a fisheye's."""
    return np.append(coefficients, np.zeros(max(5 - coefficients.size, 0)))


def check_lens_model(
    coefficients: FloatArray, stated: object, by_user: LensModel | None, source: str
) -> None:
    """Reject a fisheye, and four coefficients of an unstated model.

    Args:
        stated: the file's name of its lens model, or whether it is a fisheye; None if not stated.
        by_user: the model that the user states.

    Raises:
        FourCoefficientsError: four coefficients of an unstated model.
        StereocalError: a fisheye.
    """
    name = str(stated).strip().lower() if isinstance(stated, str) else ""
    if by_user == "fisheye" or name in FISHEYE or stated is True:
        raise fisheye_refused(source)
    settled = by_user == "brown" or name in USUAL or stated is False
    if coefficients.size == 4 and coefficients.any() and not settled:
        raise FourCoefficientsError(source)
