"""Where a point of one camera may be in the recorded, distorted image of another."""

import numpy as np
import numpy.typing as npt

from stereocal.rig.rig import PlacedCameras
from stereocal.system.array_types import FloatArray, IntArray

SAMPLES = 160
NEAREST, FARTHEST = 1e-2, 1e6
"""Depths looked at, in baselines."""


def epipolar_curve(rig: PlacedCameras, camera: str, other: str, pixel: npt.ArrayLike) -> FloatArray:
    """The epipolar line in another camera's recorded image: a curve where lenses distort.

    It ends at the edges of the image, and where the point would be infinitely far away.

    Args:
        camera: which one sees the point; other: in whose image; pixel: (2,) raw pixels, where.

    Returns:
        (n, 2) raw pixels of the other camera, from near to far; n is 0 if it cannot see the point.
    """
    (this_camera, this_pose), (other_camera, other_pose) = rig.placed[camera], rig.placed[other]
    other_from_this = other_pose @ this_pose.inverse()
    origin, ray = this_camera.rays_from(np.reshape(pixel, (1, 2)))
    if not np.isfinite(ray).all():
        return np.empty((0, 2))
    start = float(np.linalg.norm(origin))  # of the depths behind a window, which count from here

    def seen(inverse_depths: FloatArray) -> tuple[IntArray, FloatArray]:
        """The inverse depths at which the other camera sees the point, and its pixels there."""
        points = other_from_this.apply(origin + ray / inverse_depths[:, None] - start * ray)
        there = other_camera.sees(points)
        return np.flatnonzero(there), other_camera.project(points[there])

    baseline = other_from_this.baseline
    nearest, farthest = start + NEAREST * baseline, start + FARTHEST * baseline
    coarse = np.geomspace(1 / nearest, 1 / farthest, 4 * SAMPLES)
    rows, _ = seen(coarse)
    if not len(rows):
        return np.empty((0, 2))
    # Even in inverse depth is about even in the image.
    nearest, farthest = coarse[max(rows[0] - 1, 0)], coarse[min(rows[-1] + 1, len(coarse) - 1)]
    return seen(np.linspace(nearest, farthest, 2 * SAMPLES))[1]
