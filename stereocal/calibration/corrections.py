"""A recording with one thing changed, as a mistake would have changed it."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace

import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.sampling import evenly_spread

CORNERS = 4, 3
"""Columns or rows of a board that are enough to judge what was given, of an even or odd number:
turned or mirrored, they are the same ones."""
FITTING = 0.003
"""Largest noise of image points, as a fraction of the image diagonal: 2.4 px of 640x480. The best
wrong readings of frames in no order leave 0.005 and more."""


def fitting_px(cameras: Iterable[Camera]) -> float:
    """The largest noise with which points of cameras may be said to fit, in pixels."""
    return FITTING * min(float(np.hypot(*camera.image_size)) for camera in cameras)


def with_files(recording: Recording, files: Mapping[str, Camera]) -> Recording:
    """With other camera files."""
    return replace(recording, cameras={**recording.cameras, **files})


def with_changed(
    recording: Recording, names: Iterable[str], change: Callable[[Camera], Camera]
) -> Recording:
    """With some of the camera files changed."""
    return with_files(recording, {name: change(recording.cameras[name]) for name in names})


def with_pixels(
    recording: Recording, names: Iterable[str], change: Callable[[FloatArray, Camera], FloatArray]
) -> Recording:
    """With the image points (n, 2) of some cameras changed."""
    points = recording.points.copy()
    for name in names:
        of_camera = _is_of(recording, name)
        points[of_camera] = change(points[of_camera], recording.cameras[name])
    return replace(recording, points=points)


def with_targets(recording: Recording, name: str, numbers: IntArray) -> Recording:
    """With other targets in the images of one camera.

    Args:
        numbers: (k,): of each target, whose point it takes.
    """
    taken = np.argsort(numbers)[recording.target]
    of_camera = _is_of(recording, name)
    return replace(recording, target=np.where(of_camera, taken, recording.target))


def with_frames(recording: Recording, name: str, frames: IntArray, taken: IntArray) -> Recording:
    """With the points of one camera in other frames.

    Args:
        frames, taken: (f,): in the place of each frame stand the points of the taken one; what is
            not taken is left out.
    """
    of_camera, order = _is_of(recording, name), np.argsort(taken)
    place = np.searchsorted(taken[order], recording.frame).clip(max=len(taken) - 1)
    kept = ~of_camera | (taken[order][place] == recording.frame)
    frame = np.where(of_camera, frames[order][place], recording.frame)
    return replace(recording, frame=frame).where(kept)


def camera_by_camera(recording: Recording) -> Recording:
    """The recording of a bar with the columns of its table, in the order A of all cameras, B of all
    cameras, taken as A and B of each camera in turn."""
    column = recording.target * len(recording.cameras) + recording.camera
    camera, target = np.divmod(column, len(recording.object.names))
    return replace(recording, camera=camera, target=target)


def _is_of(recording: Recording, name: str) -> BoolArray:
    """(n,): which points are of a camera."""
    return np.asarray(recording.camera == [*recording.cameras].index(name))


def fewer_corners(dataset: Pair) -> Pair:
    """The data set with some corners of its board, its outermost ones among them: they are enough
    to judge what was given, which takes a tenth of the time then. Of other objects all targets."""
    if (board := dataset.board) is None:
        return dataset
    return dataset.where(np.isin(dataset.correspondences.target, some_corners(board)))


def some_corners(board: BoardPattern) -> IntArray:
    """(k,): the numbers of `CORNERS` columns and rows, the outermost ones among them."""
    columns, rows = (
        evenly_spread(number, CORNERS[number % 2]) for number in (board.columns, board.rows)
    )
    return np.asarray(rows[:, None] * board.columns + columns).ravel()


def scaled(camera: Camera, factor: float, with_centre: bool = True) -> Camera:
    """The camera of images this many times as large, or with such a focal length."""
    K = camera.K.copy()
    K[:2, : 3 if with_centre else 2] *= factor
    return replace(camera, K=K)


def undistorted(camera: Camera) -> Camera | None:
    """The lens of images whose distortion was taken out; None where there is none."""
    if not (camera.distortion.any() or camera.is_fisheye):
        return None
    return Camera(camera.K, np.zeros(4), camera.image_size, window=camera.window)
