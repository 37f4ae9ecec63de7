"""What was recorded, with one thing changed as a mistake would have changed it.

Of two cameras it is a `Dataset`, whose cameras are called by their roles; of more a `Recording`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.dataset import Dataset
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.sampling import evenly_spread

Given = TypeVar("Given", Dataset, Recording)

CORNERS = 4, 3
"""Columns or rows of a board that are enough to judge what was given, of an even or odd number:
turned or mirrored, they are the same ones."""
FITTING = 0.003
"""Largest noise of image points, as a fraction of the image diagonal: 2.4 px of 640x480. The best
wrong readings of frames in no order leave 0.005 and more."""


def cameras_of(data: Dataset | Recording | Rig) -> Mapping[str, Camera]:
    """The cameras by name."""
    if isinstance(data, Recording):
        return data.cameras
    return dict(zip(CAMERAS, (data.primary, data.secondary), strict=True))


def fitting_px(data: Dataset | Recording | Rig) -> float:
    """The largest noise with which points may be said to fit, in pixels."""
    return FITTING * min(float(np.hypot(*own.image_size)) for own in cameras_of(data).values())


def whose(data: Dataset | Recording, names: Sequence[str]) -> str:
    """One camera's or all cameras', for messages."""
    if len(names) > 1:
        return "cameras'"
    return f"{names[0]} camera's" if isinstance(data, Dataset) else f"camera {names[0]}'s"


def of_which(data: Dataset | Recording, names: Sequence[str], one: str = "one camera") -> str:
    """Which cameras, where two cannot tell which of them it is."""
    if isinstance(data, Dataset):
        return "both cameras" if len(names) > 1 else one
    return "all cameras" if len(names) > 1 else f"camera {names[0]}"


def with_files(data: Given, files: Mapping[str, Camera]) -> Given:
    """With other camera files."""
    if isinstance(data, Recording):
        return replace(data, cameras={**data.cameras, **files})
    changes: dict[str, Any] = dict(files)
    return replace(data, **changes)


def with_changed(data: Given, names: Iterable[str], change: Callable[[Camera], Camera]) -> Given:
    """With some of the camera files changed."""
    cameras = cameras_of(data)
    return with_files(data, {name: change(cameras[name]) for name in names})


def with_pixels(
    data: Given, names: Iterable[str], change: Callable[[FloatArray, Camera], FloatArray]
) -> Given:
    """With the image points (n, 2) of some cameras changed."""
    cameras = cameras_of(data)
    if isinstance(data, Dataset):
        rows = data.correspondences
        changes: dict[str, Any] = {n: change(getattr(rows, n), cameras[n]) for n in names}
        return replace(data, correspondences=replace(rows, **changes))
    points = data.points.copy()
    for name in names:
        own = _is_of(data, name)
        points[own] = change(points[own], cameras[name])
    return replace(data, points=points)


def with_targets(data: Given, name: str, numbers: IntArray) -> Given:
    """With other targets in the images of one camera, of two the secondary.

    Args:
        numbers: (k,): of each target, whose point it takes.
    """
    if isinstance(data, Dataset):
        return data.renumbered(numbers, data.correspondences.frames)
    taken = np.argsort(numbers)[data.target]
    return replace(data, target=np.where(_is_of(data, name), taken, data.target))


def with_frames(data: Given, name: str, frames: IntArray, taken: IntArray) -> Given:
    """With the points of one camera, of two the secondary, in other frames.

    Args:
        frames, taken: (f,): in the place of each frame stand the points of the taken one; what is
            not taken is left out.
    """
    if isinstance(data, Dataset):
        rows, of_frame = data.correspondences, dict(zip(frames, taken, strict=True))
        at = {key: row for row, key in enumerate(zip(rows.frame, rows.target, strict=True))}
        wanted = zip(rows.frame, rows.target, strict=True)
        other = np.array([at.get((of_frame[frame], target), -1) for frame, target in wanted])
        found = replace(rows, secondary=rows.secondary[other]).where(other >= 0)
        return replace(data, correspondences=found)
    own, order = _is_of(data, name), np.argsort(taken)
    place = np.searchsorted(taken[order], data.frame).clip(max=len(taken) - 1)
    kept = ~own | (taken[order][place] == data.frame)
    return replace(data, frame=np.where(own, frames[order][place], data.frame)).where(kept)


def _is_of(recording: Recording, name: str) -> BoolArray:
    """(n,): which points are of a camera."""
    return np.asarray(recording.camera == [*recording.cameras].index(name))


def fewer_corners(dataset: Dataset) -> Dataset:
    """The data set with some corners of its board, its outermost ones among them: they are enough
    to judge a reading, which takes a tenth of the time then. Of other objects all targets."""
    if (board := dataset.board) is None:
        return dataset
    rows = dataset.correspondences
    chosen = np.isin(rows.target, some_corners(board))
    return replace(dataset, correspondences=rows.where(chosen))


def some_corners(board: BoardPattern) -> IntArray:
    """(k,): the numbers of `CORNERS` columns and rows, the outermost ones among them."""
    columns, rows = (evenly_spread(own, CORNERS[own % 2]) for own in (board.columns, board.rows))
    return np.asarray(rows[:, None] * board.columns + columns).ravel()


def scaled(camera: Camera, factor: float, with_centre: bool = True) -> Camera:
    """The camera of images this many times as large, or with such a focal length."""
    K = camera.K.copy()
    K[:2, : 3 if with_centre else 2] *= factor
    return replace(camera, K=K)
