"""Approximate a lens by fewer distortion coefficients, if the difference is negligible."""

from __future__ import annotations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded

RATIONAL = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
COEFFICIENT_NAMES = (*RATIONAL, "s1", "s2", "s3", "s4", "tx", "ty")
NEGLIGIBLE_PX = 0.02
"""Far below the precision of any detected target."""
GRID = 41


def lens(camera: Camera, count: int, which: str, where: str) -> FloatArray:
    """The first `count` coefficients, padded with zeros.

    If the lens has more, and `count` is 4 or 5, coefficients are refitted, provided that no pixel
    moves by more than `NEGLIGIBLE_PX`.
    """
    if camera.is_fisheye:
        raise StereocalError(
            f"{where} has no fisheye lens (k1 k2 k3 k4), which the {which} camera has. Choose "
            "OpenCV, Kalibr, ROS, aniposelib or COLMAP."
        )
    padded = np.zeros(max(14, count))
    padded[: len(camera.distortion)] = camera.distortion
    further = np.flatnonzero(padded[count:]) + count
    if not len(further):
        return padded[:count]
    name = COEFFICIENT_NAMES[further[0]]
    difference = ""
    if count in (4, 5):
        fitted, worst = fewer_coefficients(camera, count)
        if worst <= NEGLIGIBLE_PX:
            return fitted
        difference = f", and without it points would move by up to {rounded(worst)} px"
    raise StereocalError(
        f"{where} supports only {' '.join(COEFFICIENT_NAMES[:count])} of a lens; that of the "
        f"{which} camera also has {name} = {padded[further[0]]:g}{difference}. Calibrate the lens "
        f"with {name} fixed at 0, or choose another format."
    )


def fewer_coefficients(camera: Camera, count: int) -> tuple[FloatArray, float]:
    """The best k1 k2 p1 p2 [k3] for a lens with more, and the largest difference in px.

    Linear least squares on a grid of pixels: the model without denominator is linear in them.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID), np.linspace(0, height - 1, GRID))
    undistorted = camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
    undistorted = undistorted[np.isfinite(undistorted).all(axis=1)]
    x, y = undistorted.T
    r2 = x * x + y * y
    columns = [
        np.concatenate([x * r2, y * r2]),
        np.concatenate([x * r2**2, y * r2**2]),
        np.concatenate([2 * x * y, r2 + 2 * y * y]),
        np.concatenate([r2 + 2 * x * x, 2 * x * y]),
        np.concatenate([x * r2**3, y * r2**3]),
    ]
    normalised = Camera(np.eye(3), camera.distortion, camera.image_size)
    shift = (normalised.distort(undistorted) - undistorted).T.ravel()
    fitted, *_ = np.linalg.lstsq(np.column_stack(columns[:count]), shift, rcond=None)
    other = Camera(camera.K, fitted, camera.image_size)
    moved = other.distort(undistorted) - camera.distort(undistorted)
    worst = np.linalg.norm(moved, axis=1).max()
    return np.asarray(fitted, dtype=np.float64), float(worst)
