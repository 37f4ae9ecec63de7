"""Edges along the normals of a curve, to a fraction of a pixel."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import map_coordinates

from stereocal.rig.compiled import FloatArray

STEP = 0.5
"""px between the samples of a profile."""


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
    found = map_coordinates(image, [v, u], np.float64, order=1, mode="nearest")
    height, width = image.shape
    outside = (np.minimum(u, v) < 0) | (u > width - 1) | (v > height - 1)
    found[outside.any(axis=1)] = np.nan
    return along, found


def steepest(
    along: FloatArray, profile: FloatArray, width: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Where each profile falls most steeply, from inside to outside.

    The position is the centroid of the descent around its steepest part: without bias for any
    symmetric blur.

    Args:
        along, profile: as `profiles` returns them.
        width: half the width of the centroid's window, px.

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
