"""Caliscope: its extrinsic calibration with the bar as one constraint of length, no window opened.

Each frame is an object of two points without known shape, so Caliscope starts from an essential
matrix; a `DistanceConstraint` holds the length in its bundle adjustment.
"""

from __future__ import annotations

import logging

import numpy as np
import pandas as pd
from caliscope.cameras.camera_array import CameraArray, CameraData
from caliscope.core.calibrate_extrinsics import calibrate_extrinsics
from caliscope.core.constraints import ConstraintSet, DistanceConstraint
from caliscope.core.point_data import ImagePoints

from benchmarks.peers.solution import Peer, Solution
from stereocal.rig.camera import Camera
from stereocal.rig.dataset import Dataset

SIGMA_M = 0.002
"""Caliscope's own default for a measured distance."""


def solve(dataset: Dataset) -> Solution:
    """Its whole run: start, adjustment, robust adjustment, worst 2.5 % left out, adjustment.

    Lenses are freed (one focal factor, k1, k2) where Caliscope's depth test allows.
    """
    logging.getLogger("caliscope").setLevel(logging.ERROR)
    cameras = (dataset.primary, dataset.secondary)
    run = calibrate_extrinsics(
        ImagePoints(_table(dataset)),
        CameraArray({i: _camera(i, camera) for i, camera in enumerate(cameras)}),
        ConstraintSet(
            (DistanceConstraint(0, 0, 0, 1, dataset.target_distance_m, SIGMA_M),), frozenset()
        ),
    )
    found = [run.capture_volume.camera_array.cameras[i] for i in (0, 1)]
    R = np.asarray(found[1].rotation @ found[0].rotation.T)
    T = np.asarray(found[1].translation - R @ found[0].translation).ravel()
    first, second = (
        Camera(np.asarray(one.matrix), np.asarray(one.distortions).ravel(), camera.image_size)
        for one, camera in zip(found, cameras, strict=True)
    )
    return Solution(R, T, (first, second))


def _camera(number: int, camera: Camera) -> CameraData:
    lens = np.zeros(5)
    lens[: min(len(camera.distortion), 5)] = camera.distortion[:5]
    return CameraData(number, camera.image_size, matrix=camera.K.copy(), distortions=lens)


def _table(dataset: Dataset) -> pd.DataFrame:
    rows = dataset.correspondences
    return pd.concat(
        [
            pd.DataFrame(
                {
                    "sync_index": rows.frame,
                    "cam_id": number,
                    "object_id": 0,
                    "keypoint_id": rows.target,
                    "img_loc_x": points[:, 0],
                    "img_loc_y": points[:, 1],
                    "obj_loc_x": np.nan,
                    "obj_loc_y": np.nan,
                    "obj_loc_z": np.nan,
                }
            )
            for number, points in enumerate((rows.primary, rows.secondary))
        ],
        ignore_index=True,
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
