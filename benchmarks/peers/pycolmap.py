"""pycolmap: essential matrix by LO-RANSAC, then `refine_relative_pose` over the inliers."""

import numpy as np
import pycolmap

from benchmarks.peers.solution import THRESHOLD_PX, NoSolutionError, Peer, Solution
from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair


def solve(dataset: Pair) -> Solution:
    """Raw pixels in, unit translation out, times the measured baseline.

    COLMAP puts the centre of the first pixel at (0.5, 0.5): points and centres are both moved.
    """
    rows = dataset.correspondences
    primary, secondary = _camera(dataset.primary), _camera(dataset.secondary)
    points = (rows.primary + 0.5, rows.secondary + 0.5)
    options = pycolmap.RANSACOptions()
    options.max_error = THRESHOLD_PX
    options.random_seed = 0
    found = pycolmap.estimate_essential_matrix(*points, primary, secondary, options)
    if found is None:
        raise NoSolutionError("pycolmap found no essential matrix")
    refined = pycolmap.refine_relative_pose(
        found["cam2_from_cam1"], primary, points[0], secondary, points[1], found["inlier_mask"]
    )
    if refined is None:
        raise NoSolutionError("pycolmap could not refine the pose")
    pose = refined["cam2_from_cam1"]
    t = np.asarray(pose.translation) / np.linalg.norm(pose.translation)
    return Solution(
        np.asarray(pose.rotation.matrix()),
        dataset.baseline_m * t,
        (dataset.primary, dataset.secondary),
    )


def _camera(camera: Camera) -> pycolmap.Camera:
    """OpenCV's lens up to k6; COLMAP has no skew."""
    K = camera.K
    lens = np.zeros(8)
    lens[: min(len(camera.distortion), 8)] = camera.distortion[:8]
    width, height = camera.image_size
    return pycolmap.Camera(
        model="FULL_OPENCV",
        width=width,
        height=height,
        params=[K[0, 0], K[1, 1], K[0, 2] + 0.5, K[1, 2] + 0.5, *lens],
    )


PEERS = (
    Peer(
        name="pycolmap", solve=solve, scale="measured baseline", lenses="held", outliers="LO-RANSAC"
    ),
)
