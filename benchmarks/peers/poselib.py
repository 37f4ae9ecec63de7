"""PoseLib: LO-RANSAC with the five-point solver, then a refinement of the Sampson distance."""

from typing import Any

import numpy as np
import poselib

from benchmarks.peers.solution import THRESHOLD_PX, NoSolutionError, Peer, Solution
from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray


def solve(dataset: Pair) -> Solution:
    """Undistorted pixels in, unit translation out, times the measured baseline."""
    cameras = (dataset.primary, dataset.secondary)
    points = [
        _pinhole_pixels(camera, rays.T)
        for camera, rays in zip(cameras, (dataset.rays[:2], dataset.rays[2:]), strict=True)
    ]
    pose, found = poselib.estimate_relative_pose(
        *points, *(_pinhole(camera) for camera in cameras), {"max_epipolar_error": THRESHOLD_PX}
    )
    if found["num_inliers"] < 5:
        raise NoSolutionError("PoseLib found no pose")
    t = np.asarray(pose.t) / np.linalg.norm(pose.t)
    return Solution(np.asarray(pose.R), dataset.baseline_m * t, cameras)


def _pinhole(camera: Camera) -> dict[str, Any]:
    K = camera.K
    width, height = camera.image_size
    return {
        "model": "PINHOLE",
        "width": width,
        "height": height,
        "params": [K[0, 0], K[1, 1], K[0, 2], K[1, 2]],
    }


def _pinhole_pixels(camera: Camera, rays: FloatArray) -> FloatArray:
    """Pixels of rays (n, 2) without skew, which PoseLib's pinhole does not have."""
    return rays * camera.K[[0, 1], [0, 1]] + camera.K[:2, 2]


PEERS = (
    Peer(
        name="PoseLib", solve=solve, scale="measured baseline", lenses="held", outliers="LO-RANSAC"
    ),
)
