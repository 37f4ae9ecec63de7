"""Which part of a volume both cameras see."""

from __future__ import annotations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.rig import Rig

COLUMNS, ROWS, DEPTHS = 25, 19, 13


def rays_of_image(camera: Camera, columns: int = COLUMNS, rows: int = ROWS) -> FloatArray:
    """(rows columns, 3): rays with z = 1 through a grid of pixels that spans the image.

    Raises:
        StereocalError: the lens model cannot be inverted in most of the image.
    """
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, columns), np.linspace(0, height - 1, rows))
    rays = camera.undistort(np.column_stack([u.ravel(), v.ravel()]))
    if np.isfinite(rays).all(axis=1).mean() < 0.5:
        raise StereocalError(
            "The lens model of a camera cannot be inverted in most of its image: check its focal "
            "length and distortion."
        )
    return np.column_stack([rays, np.ones(len(rays))])


def sees(camera: Camera, points_m: FloatArray, margin_px: float = 0.0) -> BoolArray:
    """(n,): whether points (n, 3) in the camera's frame are in its image.

    Far outside the view a distortion polynomial can fold back and map points into the image; such
    points undistort to another ray and do not count.
    """
    points = np.asarray(points_m, dtype=np.float64)
    pixels = camera.project(points)
    with np.errstate(invalid="ignore"):
        inside = (pixels >= margin_px) & (pixels <= np.array(camera.image_size) - 1.0 - margin_px)
    found = np.asarray(inside.all(axis=1))
    at = np.flatnonzero(found)
    if camera.distortion.any() and len(at):
        away = camera.undistort(pixels[at]) - points[at, :2] / points[at, 2:]
        found[at] = np.abs(away).max(axis=1) < 1e-6
    return found


def common_points(rig: Rig, depths_m: tuple[float, float]) -> FloatArray:
    """(n, 3): grid points of the primary's view, between two depths, that the secondary sees too.

    Raises:
        StereocalError: there are none, with the reason.
    """
    rays = rays_of_image(rig.primary)
    depths = np.linspace(*depths_m, DEPTHS)
    points = (depths[:, None, None] * rays).reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    seen = rig.pose.apply(points)
    near, far = depths_m
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


def check_common_view(rig: Rig, depths_m: tuple[float, float], bar_m: float) -> None:
    """Check that both cameras see a part of the volume, and that a bar fits into it.

    Raises:
        StereocalError: they do not, or it does not.
    """
    common = common_points(rig, depths_m)
    largest = float(np.linalg.norm(np.ptp(common, axis=0)))
    if bar_m >= largest:
        raise StereocalError(
            f"The bar of {bar_m:g} m is larger than what both cameras see from {depths_m[0]:g} to "
            f"{depths_m[1]:g} m (about {largest:.2g} m): take a shorter bar, or go farther away."
        )
