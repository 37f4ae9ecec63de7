"""A lens in fewer coefficients, where the difference is too small to see."""

from __future__ import annotations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray

COEFFICIENT_NAMES = (
    "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4", "tx", "ty",
)  # fmt: skip
UNSEEN_PX = 0.02
"""Far below what any target is located to."""
GRID = 41


def lens(camera: Camera, count: int, which: str, where: str) -> FloatArray:
    """The first `count` coefficients, padded with zeros.

    Where the lens has more, and four or five are wanted, others are fitted that differ by no more
    than 0.02 px anywhere in the image.

    Raises:
        StereocalError: no such coefficients exist.
    """
    padded = np.zeros(max(14, count))
    padded[: len(camera.distortion)] = camera.distortion
    further = np.flatnonzero(padded[count:]) + count
    if not len(further):
        return padded[:count]
    name = COEFFICIENT_NAMES[further[0]]
    difference = ""
    if count in (4, 5):
        fitted, worst = fewer_coefficients(camera, count)
        if worst <= UNSEEN_PX:
            return fitted
        difference = f", and without it points would move by up to {worst:.2g} px"
    raise StereocalError(
        f"{where} holds {' '.join(COEFFICIENT_NAMES[:count])} of a lens; that of the {which} "
        f"camera has {name} = {padded[further[0]]:g} too{difference}. Calibrate the lens with "
        f"{name} fixed at 0, or choose another format."
    )


def fewer_coefficients(camera: Camera, count: int) -> tuple[FloatArray, float]:
    """The best k1 k2 p1 p2 [k3] for a lens with more, and the largest difference in px.

    Linear least squares on a grid of pixels: OpenCV's model without its quotient is linear in these
    five.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, GRID), np.linspace(0, height - 1, GRID))
    straight = camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
    straight = straight[np.isfinite(straight).all(axis=1)]
    x, y = straight.T
    r2 = x * x + y * y
    columns = [
        np.concatenate([x * r2, y * r2]),
        np.concatenate([x * r2**2, y * r2**2]),
        np.concatenate([2 * x * y, r2 + 2 * y * y]),
        np.concatenate([r2 + 2 * x * x, 2 * x * y]),
        np.concatenate([x * r2**3, y * r2**3]),
    ]
    bare = Camera(np.eye(3), camera.distortion, camera.image_size)
    shift = (bare.distort(straight) - straight).T.ravel()
    fitted, *_ = np.linalg.lstsq(np.column_stack(columns[:count]), shift, rcond=None)
    other = Camera(camera.K, fitted, camera.image_size)
    worst = np.linalg.norm(other.distort(straight) - camera.distort(straight), axis=1).max()
    return np.asarray(fitted, dtype=np.float64), float(worst)
