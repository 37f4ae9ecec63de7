"""First poses of a fit of two cameras: of essential matrices, and with depths reversed."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import cv2
import numpy as np

from stereocal.calibration.essential import calibrate_essential, choose_pose
from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose, residuals, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray

ALIKE = 0.9
"""Cosine of the angle between the baselines of first poses from which on one of them is enough."""
PLAUSIBLE = 3.0
"""Median residuals from which on a pose with depths reversed is not tried."""


def first_poses(
    dataset: Pair, start: Pose | None, rays: FloatArray, robust: bool
) -> tuple[list[Pose], list[Pose]]:
    """Poses to begin with, the best first, and those that are like one of them.

    They are `start` or the essential pose, and a robust estimate if asked for, sorted by their
    residuals; and both with depths reversed, where that fits nearly as well.

    Args:
        rays: (4, n), of the points to fit.
    """
    if start is None:
        with suppress(StereocalError):
            start = calibrate_essential(rays, dataset.baseline_m).pose
    elif dataset.baseline_m != start.baseline:
        start = replace(start, T=start.T * (dataset.baseline_m / start.baseline))
    magsac = robust_start(dataset, rays) if robust else None
    known = [pose for pose in (start, magsac) if pose is not None]
    off = sorted((median_residual(pose, rays), k) for k, pose in enumerate(known))
    starts = [known[k] for _, k in off]
    for residual, k in off:
        twin = depth_reversed(known[k], rays)
        if twin is not None and median_residual(twin, rays) < PLAUSIBLE * residual:
            starts.append(twin)
    apart: list[Pose] = []
    alike: list[Pose] = []
    for pose in starts:
        cosines = [pose.T @ it.T / (pose.baseline * it.baseline) for it in apart]
        (apart if max(cosines, default=0.0) < ALIKE else alike).append(pose)
    return apart, alike


def depth_reversed(pose: Pose, rays: FloatArray) -> Pose | None:
    """The pose that points in a small part of the images, nearly all at one depth, fit nearly as
    well: with their depths reversed, and the cameras turned about them the other way (Necker).

    None if no point is in front of both cameras.
    """
    points = triangulate_rays(pose.R, pose.T, rays)
    points = points[np.isfinite(points[:, 2])]
    if not len(points):
        return None
    middle = points.mean(axis=0)
    seen = pose.apply(middle)
    # Both views mirrored along the line of sight: together a rotation again.
    of_primary, of_secondary = (
        np.eye(3) - 2.0 * np.outer(point, point) / (point @ point) for point in (middle, seen)
    )
    R = of_secondary @ pose.R @ of_primary
    return Pose(R, seen - R @ middle)


def median_residual(pose: Pose, rays: FloatArray) -> float:
    """The median of the absolute residuals of pairs with rays (4, n)."""
    return float(np.median(np.abs(residuals(pose.essential, rays[:2].T, rays[2:].T))))


def robust_start(dataset: Pair, rays: FloatArray) -> Pose | None:
    """The pose that `robust_pose` finds, with the baseline of the data set."""
    pose = robust_pose((dataset.primary, dataset.secondary), rays)
    return pose and Pose(pose.R, dataset.baseline_m * pose.T)


def robust_pose(cameras: Sequence[Camera], rays: FloatArray, samples: int = 1000) -> Pose | None:
    """The pose of an essential matrix robust to wrong pairs (MAGSAC++, from OpenCV), with a
    baseline of 1.

    None if there are fewer than 6 pairs or no solution.

    Args:
        rays: (4, n), as in `geometry`.
        samples: the largest number that is drawn; where few pairs are wrong, some ten are.
    """
    if rays.shape[1] < 6:
        return None
    focal = [
        np.median(camera.local_focal_px(points.T))
        for camera, points in zip(cameras, (rays[:2], rays[2:]), strict=True)
    ]
    E, _ = cv2.findEssentialMat(
        np.ascontiguousarray(rays[:2].T),
        np.ascontiguousarray(rays[2:].T),
        np.eye(3),
        method=cv2.USAC_MAGSAC,
        prob=0.9999,
        threshold=2.0 / float(np.sqrt(np.prod(focal))),
        maxIters=samples,
    )
    if E is None or np.shape(E) != (3, 3):
        return None
    R, t, in_front = choose_pose(np.asarray(E, dtype=np.float64), rays)
    return Pose(R, t) if in_front else None
