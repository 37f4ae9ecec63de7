"""Reconstruct 3D points from matched pairs, with reprojection errors and standard errors."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt

from stereocal.errors import DAMAGED, StereocalError
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.geometry import (
    Angles,
    Pose,
    reprojection_errors_of_rays,
    stack_rays,
    triangulate_rays,
)
from stereocal.rig.parameters import RigParameters
from stereocal.system.json_text import read_json

POSE_NAMES = (*Angles._fields, "baseline_m")
RAY_STEP = 1e-6
POSE_STEP = 1e-6
"""Steps of the derivatives: rad for rays and angles, metres for the baseline. Truncation and
rounding errors of the central differences are below 1e-8."""


@dataclass(frozen=True, eq=False)
class Points:
    """Points of n pairs."""

    xyz: FloatArray
    """(n, 3) metres; NaN where the rays do not meet in front of both cameras."""
    error_px: FloatArray
    """(n,) reprojection error, mean over both cameras; NaN likewise."""
    sigma_m: FloatArray | None = None
    """(n, 3) standard error of each coordinate; None if no noise is known."""
    outside_volume: BoolArray | None = None
    """(n,): not in the volume of the bars; true for NaN, None if the volume is unknown."""


def reconstruct_points(
    rig: RigParameters,
    primary_px: npt.ArrayLike,
    secondary_px: npt.ArrayLike,
    world: Pose | None = None,
    sigma_px: float | None = None,
    pose_covariance: npt.ArrayLike | None = None,
) -> Points:
    """Reconstruct matched pairs by midpoint triangulation.

    Args:
        primary_px: (n, 2) raw pixels; `secondary_px`: (n, 2), their partners row by row.
        world: `world_from_primary`; None: points in the primary's frame.
        sigma_px: standard deviation of one pixel coordinate, for the standard errors. If this and
            `pose_covariance` are None, those of a refined file are used.
        pose_covariance: (6, 6) of yaw, pitch, roll, delta, epsilon (rad) and baseline (m), added to
            the effect of image noise. Its part is common to all points: distances between points
            are more precise than their positions.

    Raises:
        StereocalError: an invalid noise or covariance.
    """
    rays = stack_rays(rig.primary.undistort(primary_px), rig.secondary.undistort(secondary_px))
    xyz = triangulate_rays(rig.pose.R, rig.pose.T, rays)
    scale = np.array([rig.primary.pixel_scale, rig.secondary.pixel_scale])
    error = reprojection_errors_of_rays(rig.pose.R, rig.pose.T, rays, scale).mean(axis=1)
    sigma = None
    if sigma_px is None and pose_covariance is None:
        sigma_px, pose_covariance = noise_of_file(rig)
    if sigma_px is not None or pose_covariance is not None:
        covariance = point_covariances(rig, rays, sigma_px or 0.0, pose_covariance)
        if world is not None:
            covariance = world.R @ covariance @ world.R.T
        sigma = np.sqrt(np.einsum("nii->ni", covariance))
    outside = None if rig.volume is None else ~rig.volume.contains(xyz)
    return Points(xyz if world is None else world.apply(xyz), error, sigma, outside)


def noise_of_file(rig: RigParameters) -> tuple[float | None, FloatArray | None]:
    """Image noise (px) and covariance (6, 6) of the pose of a refined file, else None.

    The covariance of the lenses is ignored, so standard errors are slightly too small far from the
    image's centre.
    """
    stored = getattr(rig, "uncertainties", None)
    if not stored:
        return None, None
    try:
        order = [stored["covariance"]["of"].index(name) for name in POSE_NAMES]
        whole = np.array(stored["covariance"]["matrix"], dtype=np.float64)
        return float(stored["sigma_px"]["value"]), whole[np.ix_(order, order)]
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise StereocalError(
            f"The uncertainties of the parameter file cannot be read ({error})."
        ) from error


def point_covariances(
    rig: RigParameters,
    rays: FloatArray,
    sigma_px: float,
    pose_covariance: npt.ArrayLike | None = None,
) -> FloatArray:
    """Covariances (n, 3, 3) of points from rays (4, n), m^2 in the primary's frame, first order.

    The noise applies to the undistorted image, equal in both coordinates and cameras.

    Raises:
        StereocalError: a negative noise, or a covariance that is not a symmetric (6, 6) table.
    """
    if not (np.isfinite(sigma_px) and sigma_px >= 0):
        raise StereocalError(f"The image noise is {sigma_px} px: it must be 0 or more.")
    R, T = rig.pose.R, rig.pose.T
    total = np.zeros((rays.shape[1], 3, 3))
    for camera, rows in ((rig.primary, slice(0, 2)), (rig.secondary, slice(2, 4))):
        derivatives = []
        for row in range(rows.start, rows.stop):
            step = np.zeros((4, 1))
            step[row] = RAY_STEP
            ahead, behind = triangulate_rays(R, T, rays + step), triangulate_rays(R, T, rays - step)
            derivatives.append((ahead - behind) / (2 * RAY_STEP))
        by_pixel = np.stack(derivatives, axis=2) @ np.linalg.inv(camera.K[:2, :2])
        total += sigma_px**2 * by_pixel @ by_pixel.transpose(0, 2, 1)
    if pose_covariance is not None:
        covariance = np.array(pose_covariance, dtype=np.float64)
        if covariance.shape != (6, 6) or not np.allclose(covariance, covariance.T, rtol=1e-6):
            raise StereocalError(
                "The covariance of the pose must be a symmetric 6x6 table, in the order yaw, "
                "pitch, roll, delta, epsilon, baseline."
            )
        J = _pose_jacobian(rig.pose, rays)
        total += J @ covariance @ J.transpose(0, 2, 1)
    return total


def _pose_jacobian(pose: Pose, rays: FloatArray) -> FloatArray:
    """(n, 3, 6): derivatives of points with respect to the five angles and the baseline."""
    here = np.array([*pose.angles, pose.baseline])
    derivatives = []
    for k in range(6):
        sides = []
        for sign in (1, -1):
            moved = here.copy()
            moved[k] += sign * POSE_STEP
            there = Pose.from_angles(Angles(*moved[:5]), moved[5])
            sides.append(triangulate_rays(there.R, there.T, rays))
        derivatives.append((sides[0] - sides[1]) / (2 * POSE_STEP))
    return np.stack(derivatives, axis=2)


LARGEST_TABLE = 1_000_000


def read_world(path: str | Path) -> Pose:
    """`world_from_primary` of a file with a 4x4 table: JSON (rows in brackets) or CSV.

    `x_world = R @ x_primary + t`; the last row is 0 0 0 1; metres.

    Raises:
        StereocalError: no such file or table, or not a rotation and translation.
    """
    path = Path(path)
    try:
        if path.stat().st_size > LARGEST_TABLE:
            raise StereocalError(f"{path}: the file is too large for a 4x4 table of numbers.")
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise StereocalError(f"{path}: the file cannot be read ({error}).") from error
    try:
        if path.suffix.lower() == ".json":
            table = np.array(read_json(text, str(path)), dtype=np.float64)
        else:
            rows = [row for row in csv.reader(io.StringIO(text)) if any(c.strip() for c in row)]
            table = np.array(rows, dtype=np.float64)
    except (*DAMAGED, csv.Error) as error:
        if isinstance(error, StereocalError):
            raise
        raise StereocalError(f"{path}: this is not a 4x4 table of numbers.") from error
    if table.shape != (4, 4) or not np.array_equal(table[3], [0, 0, 0, 1]):
        raise StereocalError(
            f"{path}: a world frame needs a 4x4 table whose last row is 0 0 0 1 "
            "(x_world = R x_primary + t, in metres)."
        )
    try:
        return Pose(table[:3, :3], table[:3, 3])
    except StereocalError as error:
        raise StereocalError(
            f"{path}: the world frame must be a rotation and a translation: {error}"
        ) from error
