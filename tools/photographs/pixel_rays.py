"""The rays of many pixels by spline interpolation, and their intersection with a plane."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.interpolate import RectBivariateSpline

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray

NODE_PX = 16.0
"""Spacing of the pixels that are undistorted by Newton's method; cubic splines interpolate between
them. The error is 2e-4 px for a wide lens (f = 500 px, k1 = -0.3), and far less for a long one."""


def ray_splines(
    camera: Camera, columns: npt.NDArray[np.floating], rows: npt.NDArray[np.floating]
) -> tuple[RectBivariateSpline, RectBivariateSpline]:
    """Splines of normalised x and y as functions of (rows, columns) in pixels.

    Args:
        columns, rows: ascending pixel coordinates; the splines are valid from first to last.

    Raises:
        StereocalError: the lens model cannot be inverted in this range.
    """
    nodes = [
        np.linspace(values[0], values[-1], max(4, int(np.ceil(np.ptp(values) / NODE_PX)) + 1))
        for values in (columns, rows)
    ]
    grid = np.stack(np.meshgrid(*nodes), axis=-1)
    rays = camera.undistort(grid.reshape(-1, 2)).reshape(grid.shape)
    if not np.isfinite(rays).all():
        raise StereocalError("The lens cannot be inverted everywhere in the image to be rendered.")
    x, y = (RectBivariateSpline(nodes[1], nodes[0], rays[..., i]) for i in range(2))
    return x, y


def on_plane(
    x: FloatArray, y: FloatArray, plane_from_ray: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Intersections of rays with a plane: x and y in its frame; NaN if not in front of the camera.

    Args:
        x, y: normalised image coordinates, of any equal shape.
        plane_from_ray: (3, 3), the inverse of `[r1 r2 T]` of the plane's pose.
    """
    H = plane_from_ray
    scale = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    scale[scale <= 0] = np.nan
    return (
        (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / scale,
        (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / scale,
    )
