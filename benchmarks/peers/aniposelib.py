"""aniposelib: its iterative bundle adjustment, each bar as a board of two points."""

from __future__ import annotations

import contextlib
import io
from typing import Any

import cv2
import numpy as np
from aniposelib.cameras import Camera as AniposeCamera
from aniposelib.cameras import CameraGroup

from benchmarks.peers import opencv
from benchmarks.peers.solution import Peer, Solution
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import triangulate_rays


def solve(dataset: Dataset) -> Solution:
    """From OpenCV's robust pose; the lenses are held.

    Its way to free a lens makes fx = fy and sets k3, p1, p2 to 0, which no lens here obeys.
    """
    np.random.seed(0)  # noqa: NPY002  # aniposelib draws from the global generator
    start = opencv.solve(dataset)
    cameras = CameraGroup(
        [
            _camera("primary", dataset.primary, np.eye(3), np.zeros(3)),
            _camera("secondary", dataset.secondary, start.R, start.T),
        ]
    )
    rows = dataset.correspondences
    points = np.stack([rows.primary, rows.secondary])
    with contextlib.redirect_stdout(io.StringIO()):
        cameras.bundle_adjust_iter(points, _boards(dataset, start), only_extrinsics=True)
    (R0, T0), (R1, T1) = (
        (cv2.Rodrigues(one.get_rotation())[0], one.get_translation()) for one in cameras.cameras
    )
    R = np.asarray(R1 @ R0.T)
    return Solution(R, T1 - R @ T0, (dataset.primary, dataset.secondary))


def _camera(name: str, camera: Camera, R: FloatArray, T: FloatArray) -> AniposeCamera:
    return AniposeCamera(
        matrix=camera.K.copy(),
        dist=camera.distortion.copy(),
        size=camera.image_size,
        rvec=cv2.Rodrigues(R)[0].ravel(),
        tvec=T,
        name=name,
    )


def _boards(dataset: Dataset, start: Solution) -> dict[str, Any]:
    """Each frame's bar as a board: A at its origin, B on its x axis, and where it starts."""
    rows = dataset.correspondences
    n = len(rows)
    points = triangulate_rays(start.R, start.T, dataset.rays)
    known = np.isfinite(points).all(axis=1)
    points[~known] = np.median(points[known], axis=0)
    shape = np.zeros((n, 3))
    shape[rows.target == 1, 0] = dataset.target_distance_m
    rotations, places = np.zeros((2, n, 3)), np.zeros((2, n, 3))
    for i in range(n):
        ends = [points[(rows.frame == rows.frame[i]) & (rows.target == t)] for t in (0, 1)]
        a = ends[0][0] if len(ends[0]) else points[i]
        b = ends[1][0] if len(ends[1]) else points[i] + [1.0, 0.0, 0.0]
        turn = _turn_to(b - a)
        for camera, R, T in ((0, np.eye(3), np.zeros(3)), (1, start.R, start.T)):
            rotations[camera, i] = cv2.Rodrigues(R @ turn)[0].ravel()
            places[camera, i] = R @ a + T
    return {"ids": rows.frame.copy(), "objp": shape, "rvecs": rotations, "tvecs": places}


def _turn_to(along: FloatArray) -> FloatArray:
    """A rotation whose x axis points along a vector (3,)."""
    x = along / np.linalg.norm(along)
    y = np.cross(x, np.eye(3)[np.argmin(np.abs(x))])
    y /= np.linalg.norm(y)
    return np.column_stack([x, y, np.cross(x, y)])


PEERS = (
    Peer(
        name="aniposelib, bars as boards",
        solve=solve,
        scale="measured baseline as start, bar",
        lenses="held",
        outliers="points above a falling limit left out",
    ),
)
