"""Distances of one frame's targets from the epipolar lines computed from the other frames."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from stereocal.calibration.essential import MINIMUM_PAIRS, calibrate_essential
from stereocal.errors import StereocalError
from stereocal.frames.frame import Frame, correspondences_of
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import stack_rays
from stereocal.rig.rig import Rig


def epipolar_residuals_px(
    frames: Sequence[Frame], number: int, cameras: tuple[Camera, Camera]
) -> dict[int, float]:
    """Distance from the epipolar line of each target that both photographs of a frame show.

    The essential matrix is estimated from the other used frames, without the frame itself.

    Returns:
        By target (0 A, 1 B), px as of `Camera`, the larger of the two cameras.
    """
    others = [frame for frame in frames if frame.use and frame.frame != number]
    shared = sum(len(frame.targets_in_both) for frame in others)
    if shared < MINIMUM_PAIRS:
        raise StereocalError(
            f"The other used frames have {shared} point pairs; at least {MINIMUM_PAIRS} are needed "
            "for the epipolar geometry."
        )
    (own,) = (frame for frame in frames if frame.frame == number)
    if not own.targets_in_both:
        return {}
    rows = correspondences_of(others)
    rays = stack_rays(cameras[0].undistort(rows.primary), cameras[1].undistort(rows.secondary))
    rays = rays[:, np.isfinite(rays).all(axis=0)]
    pose = calibrate_essential(rays, 1.0).pose
    points = correspondences_of([own.used(True)])
    distances = Rig(*cameras, pose).epipolar_distances(points.primary, points.secondary)
    worst = distances.max(axis=1)
    return {int(t): float(away) for t, away in zip(points.target, worst, strict=True)}
