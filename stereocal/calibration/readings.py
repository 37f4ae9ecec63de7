"""Other readings of what was given: files exchanged, images mirrored, frames in another order.

A reading changes the data set, as one typical mistake would have changed it.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from stereocal.calibration.board_numbering import run_counter_clockwise
from stereocal.rig.camera import CAMERAS, Camera, CameraName, LensModel
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

ONE_OR_BOTH: tuple[tuple[CameraName, ...], ...] = (
    ("primary",),
    ("secondary",),
    ("primary", "secondary"),
)


COUNT_ALIKE = "Count the corners of both cameras row by row, from the same corner of the board."
MOST_CORNERS = 4, 3
"""Columns and rows of a board that are enough to judge a reading."""
FEWEST_TO_SHIFT = 8
"""Frames, of which two may be lost."""

FITTING = 0.003
"""Largest noise of image points, as a fraction of the image diagonal: 2.4 px of 640x480. The best
wrong readings of frames in no order leave 0.005 and more."""


def fitting_px(dataset: Dataset) -> float:
    """The largest noise with which points may be said to fit, in pixels."""
    cameras = dataset.primary, dataset.secondary
    return FITTING * min(float(np.hypot(*camera.image_size)) for camera in cameras)


@dataclass(frozen=True)
class Claim:
    """What may be wrong, and what to do about it."""

    claim: str
    remedy: str


@dataclass(frozen=True)
class Reading(Claim):
    """A claim about two cameras, and the corrected data set."""

    corrected: Callable[[], Dataset]
    """Raises a `StereocalError` where such a data set is impossible."""
    cameras: tuple[CameraName, ...] = (CAMERAS[1],)
    """Whose files or points it changes."""
    is_likely: bool = False
    """Whether something else speaks for it, so that it is judged in any case."""


def changed(
    dataset: Dataset, cameras: Sequence[CameraName], change: Callable[[Camera], Camera]
) -> Dataset:
    """The data set with some of its cameras changed."""
    changes: dict[str, Any] = {which: change(getattr(dataset, which)) for which in cameras}
    return replace(dataset, **changes)


def whose(cameras: Sequence[CameraName]) -> str:
    """One camera's or both cameras', for messages."""
    return f"{cameras[0]} camera's" if len(cameras) == 1 else "cameras'"


def same_lens(one: Camera, other: Camera) -> bool:
    """Whether two cameras have the same lens, as where one file was given twice."""
    same = np.array_equal(one.K, other.K) and np.array_equal(one.distortion, other.distortion)
    return same and one.model == other.model


def readings_of_cameras(dataset: Dataset) -> Iterator[Reading]:
    """Readings of the camera files and of the targets' labels, tried with every data set."""
    one, two = dataset.primary, dataset.secondary
    if not same_lens(one, two):
        sizes = {"primary": one.image_size, "secondary": two.image_size}
        exchanged = {"primary": two, "secondary": one}
        own = {name: replace(exchanged[name], image_size=size) for name, size in sizes.items()}
        yield Reading(
            "The two camera files seem to be exchanged",
            "Exchange the files.",
            partial(replace, dataset, **own),
            CAMERAS,
        )
    frames, board = dataset.correspondences.frames, dataset.board
    yield Reading(
        "A and B seem to be exchanged in one of the cameras, in all frames"
        if board is None
        else "The corners of one camera seem to be counted from the opposite corner of the board",
        "Exchange the two targets of one camera." if board is None else COUNT_ALIKE,
        partial(dataset.with_targets_exchanged, frames),
    )
    # The lens of a mirrored camera is mirrored too, so that the images tell by its centre alone.
    if run_counter_clockwise(dataset):
        for axis, claim in enumerate(
            (
                "The images of both cameras seem to be mirrored: u is counted from the right",
                "v of both cameras seems to be counted from below",
            )
        ):
            yield Reading(
                claim,
                "Give the images, or their points, as the cameras recorded them.",
                partial(_mirrored, dataset, CAMERAS, axis),
                CAMERAS,
                is_likely=True,
            )
    for cameras in ONE_OR_BOTH:
        yield Reading(
            f"The {whose(cameras)} distortion coefficients seem to have the wrong sign",
            "Some programs write the inverse (undistorting) coefficients: export the lens in "
            "OpenCV's convention, or change the signs.",
            partial(changed, dataset, cameras, _negated),
            cameras,
        )
    for cameras in ONE_OR_BOTH:
        if all(_has_other_model(getattr(dataset, which)) for which in cameras):
            yield Reading(
                f"The {whose(cameras)} four distortion coefficients seem to be of the other lens "
                "model (k1 k2 k3 k4 of a fisheye, k1 k2 p1 p2 of the usual lens)",
                "Give the camera file again, and state which they are.",
                partial(changed, dataset, cameras, _of_other_model),
                cameras,
            )
    for cameras, camera in zip(ONE_OR_BOTH, (one, two), strict=False):
        factor = camera.size_factor
        if factor is not None:
            width, height = camera.image_size
            yield Reading(
                f"The {whose(cameras)} matrix K seems to be that of an image {rounded(factor, 3)} "
                f"times as large as {width}x{height} px",
                "Provide K for the size of the images in which the points were measured.",
                partial(changed, dataset, cameras, partial(scaled, factor=1.0 / factor)),
                cameras,
            )


def readings_of_points(dataset: Dataset) -> Iterator[Reading]:
    """Readings of the table of points, tried where the data do not fit."""
    for axis, claim, remedy in (
        (
            0,
            "The images of one camera seem to be mirrored: u is counted from the right",
            "Mirror them back, or replace u by the width - 1 - u. Which camera it is, images of "
            "writing show.",
        ),
        (
            1,
            "v of one camera seems to be counted from below",
            "Replace it by the height - 1 - v. Which camera it is, a point near the ground shows.",
        ),
    ):
        for which in CAMERAS:
            corrected = partial(_mirrored, dataset, (which,), axis)
            yield Reading(claim, remedy, corrected, (which,))
    for cameras in ONE_OR_BOTH:
        where = "both cameras" if len(cameras) > 1 else "one camera"
        yield Reading(
            f"u and v of {where} seem to be exchanged",
            "Exchange its two columns, as where rows stand before columns.",
            partial(_transposed, dataset, cameras),
            cameras,
        )
    if (board := dataset.board) is not None:
        grid = np.arange(len(board.points)).reshape(board.rows, board.columns)
        by_columns = np.arange(len(board.points)).reshape(board.columns, board.rows).T
        for numbers, how in (
            (grid[:, ::-1], "from the other end of each row"),
            (grid[::-1], "from the last row"),
            (by_columns, "column by column"),
            (by_columns[::-1, ::-1], "column by column, from the opposite corner"),
        ):
            yield Reading(
                f"The corners of one camera seem to be counted {how}",
                COUNT_ALIKE,
                partial(dataset.renumbered, numbers.ravel(), dataset.correspondences.frames),
            )
    if dataset.correspondences.rigid_object is None:
        yield Reading(
            "The columns of the table seem to stand camera by camera: A and B of one camera, then "
            "those of the other",
            "Put them in the order A of both cameras, B of both cameras, or name the columns.",
            partial(_camera_by_camera, dataset),
            CAMERAS,
        )


def readings_of_frames(dataset: Dataset) -> Iterator[Reading]:
    """Readings of the numbers of the secondary's frames, tried where the data do not fit."""
    frames = dataset.correspondences.frames
    for order in orders_of_words(frames):
        yield Reading(
            "The frames of one camera seem to be in the order of words (1, 10, 11, ... 2, 20)",
            "Sort its files by their numbers, or write these with zeros before: 01, 02, ...",
            partial(_reordered, dataset, dict(zip(frames.tolist(), order, strict=True))),
        )
    for whole in (1, -1, 2, -2) if len(frames) > FEWEST_TO_SHIFT else ():
        moments = {int(frame): int(frame) - whole for frame in frames}
        yield Reading(*counted_apart(frames, whole), partial(_reordered, dataset, moments))


def counted_apart(frames: IntArray, whole: int) -> tuple[str, str]:
    """The claim and the remedy where the secondary's frames are counted so many too high."""
    frame = int(frames[min(max(whole, 0), len(frames) - 1)])
    return (
        f"The frames of the two cameras seem to be counted {abs(whole)} apart: the secondary's "
        f"frame {frame - whole} is of the same moment as the primary's frame {frame}",
        "Correct the numbers: one camera has an image less, or one more, at its start.",
    )


def orders_of_words(frames: Any) -> Iterator[list[int]]:
    """Which frame's points stand in the place of each frame, if they were counted from 0, from 1 or
    as they are, and the inverse of each order."""
    count, seen = len(frames), set[tuple[int, ...]]()
    for numbers in (frames.tolist(), range(count), range(1, count + 1)):
        order = sorted(range(count), key=lambda place: str(numbers[place]))
        for places in (order, np.argsort(order).tolist()):
            if tuple(places) not in seen and places != list(range(count)):
                seen.add(tuple(places))
                yield frames[places].tolist()


def _mirrored(dataset: Dataset, cameras: Sequence[CameraName], axis: int) -> Dataset:
    changes: dict[str, Any] = {}
    for which in cameras:
        changes[which] = points = getattr(dataset.correspondences, which).copy()
        points[:, axis] = getattr(dataset, which).image_size[axis] - 1 - points[:, axis]
    return replace(dataset, correspondences=replace(dataset.correspondences, **changes))


def _transposed(dataset: Dataset, cameras: Sequence[CameraName]) -> Dataset:
    rows = dataset.correspondences
    changes: dict[str, Any] = {which: getattr(rows, which)[:, ::-1] for which in cameras}
    return replace(dataset, correspondences=replace(rows, **changes))


def fewer_corners(dataset: Dataset) -> Dataset:
    """The data set with some corners of its board, its outermost ones among them: they are enough
    to judge a reading, which takes a tenth of the time then. Of other objects all targets."""
    if (board := dataset.board) is None:
        return dataset
    kept = [*map(evenly_spread, (board.columns, board.rows), MOST_CORNERS)]
    row, column = np.divmod(dataset.correspondences.target, board.columns)
    chosen = np.isin(column, kept[0]) & np.isin(row, kept[1])
    return replace(dataset, correspondences=dataset.correspondences.where(chosen))


def _camera_by_camera(dataset: Dataset) -> Dataset:
    return replace(dataset, correspondences=dataset.correspondences.camera_by_camera())


def _reordered(dataset: Dataset, of_frame: dict[int, int]) -> Dataset:
    """The secondary's points of another frame in the place of each, where that has them."""
    rows = dataset.correspondences
    at = {key: row for row, key in enumerate(zip(rows.frame, rows.target, strict=True))}
    other = np.array(
        [at.get((of_frame[f], t), -1) for f, t in zip(rows.frame, rows.target, strict=True)]
    )
    found = replace(rows, secondary=rows.secondary[other]).where(other >= 0)
    return replace(dataset, correspondences=found)


def _has_other_model(camera: Camera) -> bool:
    """Whether the lens has just the four coefficients that the other model has too."""
    return camera.is_fisheye or bool(camera.distortion.size == 4 and camera.distortion.any())


def _of_other_model(camera: Camera) -> Camera:
    model: LensModel = "brown" if camera.is_fisheye else "fisheye"
    return Camera(camera.K, camera.distortion[:4], camera.image_size, model=model)


def _negated(camera: Camera) -> Camera:
    return replace(camera, distortion=-camera.distortion)


def scaled(camera: Camera, factor: float, with_centre: bool = True) -> Camera:
    """The camera of images this many times as large, or with such a focal length."""
    K = camera.K.copy()
    K[:2, : 3 if with_centre else 2] *= factor
    return replace(camera, K=K)


def centred(camera: Camera, centre_px: FloatArray) -> Camera:
    """The camera with another principal point."""
    K = camera.K.copy()
    K[:2, 2] = centre_px
    return replace(camera, K=K)
