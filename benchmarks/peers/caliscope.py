"""Caliscope: its extrinsic calibration with the bar as one constraint of length, no window opened.

Each frame is an object of points without known shape, so Caliscope starts from essential matrices;
a `DistanceConstraint` holds each length in its bundle adjustment.
"""

import logging
from itertools import combinations

import numpy as np
import pandas as pd
from caliscope.cameras.camera_array import CameraArray, CameraData
from caliscope.core.calibrate_extrinsics import calibrate_extrinsics
from caliscope.core.constraints import ConstraintSet, DistanceConstraint
from caliscope.core.point_data import ImagePoints

from benchmarks.peers.solution import Peer, Solution
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording

SIGMA_M = 0.002
"""Caliscope's own default for a measured distance."""


def solve(dataset: Pair) -> Solution:
    """Of two cameras."""
    found = solve_rig(dataset.recording)
    (first, start), (second, end) = found.values()
    pose = end @ start.inverse()
    return Solution(pose.R, pose.T, (first, second))


def solve_rig(recording: Recording) -> dict[str, tuple[Camera, Pose]]:
    """Its whole run: start, adjustment, robust adjustment, worst 2.5 % left out, adjustment.

    Lenses are freed (one focal factor, k1, k2) where Caliscope's depth test allows.
    """
    logging.getLogger("caliscope").setLevel(logging.ERROR)
    cameras = [*recording.cameras.values()]
    lengths = tuple(
        DistanceConstraint(0, i, 0, j, float(recording.object.distance(i, j)), SIGMA_M)
        for i, j in combinations(np.unique(recording.target).tolist(), 2)
    )
    run = calibrate_extrinsics(
        ImagePoints(_table(recording)),
        CameraArray({i: _camera(i, camera) for i, camera in enumerate(cameras)}),
        ConstraintSet(lengths, frozenset()),
    )
    found = {}
    for number, (name, camera) in enumerate(recording.cameras.items()):
        own = run.capture_volume.camera_array.cameras[number]
        lens = np.asarray(own.distortions).ravel()
        found[name] = (
            Camera(np.asarray(own.matrix), lens, camera.image_size),
            Pose(np.asarray(own.rotation), np.asarray(own.translation).ravel()),
        )
    return found


def _camera(number: int, camera: Camera) -> CameraData:
    lens = np.zeros(5)
    lens[: min(len(camera.distortion), 5)] = camera.distortion[:5]
    return CameraData(number, camera.image_size, matrix=camera.K.copy(), distortions=lens)


def _table(recording: Recording) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "sync_index": recording.frame,
            "cam_id": recording.camera,
            "object_id": 0,
            "keypoint_id": recording.target,
            "img_loc_x": recording.points[:, 0],
            "img_loc_y": recording.points[:, 1],
        }
    )


PEERS = (
    Peer(
        name="Caliscope, wand rows",
        solve=solve,
        scale="bar 2 mm",
        lenses="f, k1, k2 freed if depths differ",
        outliers="soft_l1, worst 2.5 % of points left out",
    ),
)
