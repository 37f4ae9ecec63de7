"""Which part of a volume both cameras see."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.rig import Rig

COLUMNS, ROWS, DEPTHS = 25, 19, 13
KEPT_CAMERAS = 64
FOLD_MARGIN = 1.05
"""A ray farther from the axis than this many times the farthest ray of the image is not seen."""


@lru_cache(KEPT_CAMERAS)
def rays_of_image(camera: Camera) -> FloatArray:
    """(n, 3): rays with z = 1 through a grid of pixels that spans the image."""
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, COLUMNS), np.linspace(0, height - 1, ROWS))
    rays = camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
    known = camera.uses(rays)
    if known.mean() < 0.5:
        raise StereocalError(
            "The lens model of a camera cannot be inverted in most of its image: check its focal "
            "length and distortion."
        )
    return np.column_stack([rays, np.ones(len(rays))])[known]


def sees(camera: Camera, points_m: FloatArray, margin_px: float = 0.0) -> BoolArray:
    """(n,): whether points (n, 3) in the camera's frame are in its image.

    Far outside the view a distortion polynomial can fold back and map points into the image; such
    points are farther from the axis than all rays of the image, and do not count.
    """
    points = np.asarray(points_m, dtype=np.float64)
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= margin_px) & (pixels <= np.array(camera.image_size) - 1.0 - margin_px)
    found = np.asarray(inside.all(axis=1))
    if camera.distortion.any():
        most = FOLD_MARGIN**2 * np.square(rays_of_image(camera)[:, :2]).sum(axis=1).max()
        found &= np.square(points[:, :2]).sum(axis=1) <= most * points[:, 2] ** 2
    return found


def common_points(rig: Rig, depths_m: FloatArray) -> FloatArray:
    """(n, 3): grid points of the primary's view at some depths that the secondary sees too."""
    points = (np.asarray(depths_m)[:, None, None] * rays_of_image(rig.primary)).reshape(-1, 3)
    seen = rig.pose.apply(points)
    near, far = float(depths_m[0]), float(depths_m[-1])
    if not (seen[:, 2] > 0).any():
        raise StereocalError(
            f"The volume from {near:g} to {far:g} m in front of the primary is behind the "
            "secondary camera: check R and T, or the toe-in."
        )
    common = points[sees(rig.secondary, seen)]
    if not len(common):
        raise StereocalError(
            f"The cameras see nothing in common from {near:g} to {far:g} m: turn them towards each "
            "other or bring them closer together, or choose another range."
        )
    return np.asarray(common)
