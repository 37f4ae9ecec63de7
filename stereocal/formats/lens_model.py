"""Distinguish OpenCV's standard lens model (k1 k2 p1 p2) from its fisheye model (k1 k2 k3 k4).

Both may have four coefficients; if the file does not state the model, the user must.
"""

from __future__ import annotations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import LensModel
from stereocal.rig.compiled import FloatArray

USUAL = ("brown", "plumb_bob", "radtan", "rational_polynomial", "pinhole", "opencv")
FISHEYE = ("fisheye", "equidistant", "equi", "kannala_brandt", "kannala_brandt4", "kb4")


class FourCoefficientsError(StereocalError):
    """A lens with four coefficients whose model is not stated."""

    def __init__(self, source: str) -> None:
        self.question = (
            f"{source}: the lens has 4 distortion coefficients, and the file does not say whether "
            "they are k1 k2 p1 p2 (OpenCV's usual lens) or k1 k2 k3 k4 (its fisheye)."
        )
        super().__init__(
            f"{self.question} Use --lens-model brown or fisheye, or write "
            "distortion_model: plumb_bob or equidistant into the file."
        )


def five_or_more(coefficients: FloatArray) -> FloatArray:
    """The coefficients with at least k3 = 0 appended, so that they do not look like a fisheye's."""
    return np.append(coefficients, np.zeros(max(5 - coefficients.size, 0)))


def lens_model_of(
    coefficients: FloatArray, stated: object, by_user: LensModel | None, source: str
) -> LensModel:
    """The model of a lens in a file.

    Args:
        stated: the file's name of its lens model, or whether it is a fisheye; None if not stated.
        by_user: the model that the user states, which counts if the file states none.

    Raises:
        FourCoefficientsError: four coefficients of an unstated model.
    """
    name = str(stated).strip().lower() if isinstance(stated, str) else ""
    if name in FISHEYE or stated is True:
        return "fisheye"
    if name in USUAL or stated is False:
        return "brown"
    if by_user is None and coefficients.size == 4 and coefficients.any():
        raise FourCoefficientsError(source)
    return by_user or "brown"
