"""aniposelib: its iterative bundle adjustment, each bar as a board of two points."""

import contextlib
import io
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from aniposelib.cameras import Camera as AniposeCamera
from aniposelib.cameras import CameraGroup

from benchmarks.peers import opencv
from benchmarks.peers.solution import Peer, Solution
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray, IntArray


def solve(dataset: Pair) -> Solution:
    """Of two cameras, from OpenCV's robust pose."""
    start = opencv.solve(dataset)
    poses = [Pose(np.eye(3), np.zeros(3)), Pose(start.R, start.T)]
    first, second = solve_rig(dataset.recording, poses).values()
    pose = second @ first.inverse()
    return Solution(pose.R, pose.T, (dataset.primary, dataset.secondary))


def solve_rig(recording: Recording, start: Sequence[Pose]) -> dict[str, Pose]:
    """The poses of N cameras, from first ones; the lenses are held.

    Its way to free a lens makes fx = fy and sets k3, p1, p2 to 0, which no lens here obeys.
    """
    np.random.seed(0)  # noqa: NPY002  # aniposelib draws from the global generator
    cameras = CameraGroup(
        [
            _camera(name, camera, pose.R, pose.T)
            for (name, camera), pose in zip(recording.cameras.items(), start, strict=True)
        ]
    )
    frames, pixels = recording.images()
    seen = np.argwhere(np.isfinite(pixels[..., 0]).sum(axis=2) > 1)
    points = np.moveaxis(pixels[tuple(seen.T)], 1, 0)
    with contextlib.redirect_stdout(io.StringIO()):
        placed = cameras.triangulate(points)
        boards = _boards(recording, frames[seen[:, 0]], seen[:, 1], placed, start)
        cameras.bundle_adjust_iter(points, boards, only_extrinsics=True)
    return {
        name: Pose(cv2.Rodrigues(own.get_rotation())[0], np.asarray(own.get_translation()))
        for name, own in zip(recording.cameras, cameras.cameras, strict=True)
    }


def _camera(name: str, camera: Camera, R: FloatArray, T: FloatArray) -> AniposeCamera:
    return AniposeCamera(
        matrix=camera.K.copy(),
        dist=camera.distortion.copy(),
        size=camera.image_size,
        rvec=cv2.Rodrigues(R)[0].ravel(),
        tvec=T,
        name=name,
    )


def _boards(
    recording: Recording,
    frame: IntArray,
    target: IntArray,
    points: FloatArray,
    start: Sequence[Pose],
) -> dict[str, Any]:
    """Each frame's bar as a board, its points in their own frame, and where it starts."""
    n, (first, last) = len(points), recording.object.longest
    known = np.asarray(np.isfinite(points).all(axis=1))
    points = np.where(known[:, None], points, np.median(points[known], axis=0))
    shape = recording.object.points[target]
    rotations, places = np.zeros((len(start), n, 3)), np.zeros((len(start), n, 3))
    for i in range(n):
        ends = [points[(frame == frame[i]) & (target == t)] for t in (first, last)]
        a = ends[0][0] if len(ends[0]) else points[i]
        b = ends[1][0] if len(ends[1]) else points[i] + [1.0, 0.0, 0.0]
        turn = _turn_to(b - a)
        for camera, pose in enumerate(start):
            rotations[camera, i] = cv2.Rodrigues(pose.R @ turn)[0].ravel()
            places[camera, i] = pose.apply(a)
    return {"ids": frame.copy(), "objp": shape, "rvecs": rotations, "tvecs": places}


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
