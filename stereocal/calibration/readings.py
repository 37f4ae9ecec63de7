"""Other readings of what was given: files exchanged, images mirrored, frames in another order.

A reading changes what was recorded, as one typical mistake would have changed it. Two cameras and
more have the same: of two each camera and both are tried, of more each camera and all of them.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Generic

import numpy as np

from stereocal.calibration.board_numbering import run_counter_clockwise
from stereocal.calibration.corrections import (
    Given,
    cameras_of,
    of_which,
    scaled,
    whose,
    with_changed,
    with_files,
    with_frames,
    with_pixels,
    with_targets,
)
from stereocal.rig.camera import (
    CAMERAS,
    SIZE_FACTOR_TOLERANCE,
    Camera,
    CameraName,
    LensModel,
    same_lens,
)
from stereocal.rig.dataset import Dataset
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

COUNT_ALIKE = "Count the corners of both cameras row by row, from the same corner of the board."
FOR_SIZE = "Provide K for the size of the images in which the points were measured."
INVERSE = (
    "Some programs write the inverse (undistorting) coefficients: export the lens in OpenCV's "
    "convention, or change the signs."
)
FEWEST_TO_SHIFT, FEWEST_BOARDS = 8, 4
"""Frames of a bar, and of a board, of which two may be lost: two boards tell a pose and deny it."""
ESTIMATED_HANDICAP = 1.3
"""Of readings that put a fitted value in the place of a stated one."""
SECONDARY: tuple[CameraName, ...] = (CAMERAS[1],)


@dataclass(frozen=True)
class Reading(Generic[Given]):
    """What may be wrong and what to do about it, and what was given without it."""

    claim: str
    remedy: str
    corrected: Callable[[], Given]
    """Raises a `StereocalError` where such data are impossible."""
    cameras: tuple[str, ...]
    """Whose files or points it changes."""
    is_likely: bool = False
    """Whether something else speaks for it, so that it is judged with what seems to fit better."""
    is_estimated: bool = False
    """Whether it puts a fitted value in the place of a stated one."""
    least_gain: float = 0.0
    """How many times less noise it must leave than what was given."""

    @property
    def handicap(self) -> float:
        """How many times less noise it must leave than others to be the better one."""
        return ESTIMATED_HANDICAP if self.is_estimated and not self.is_likely else 1.0


@dataclass(frozen=True)
class Group:
    """Cameras that one mistake may concern, and two cameras that show it."""

    names: tuple[str, ...]
    shown: Dataset
    roles: tuple[CameraName, ...]
    """Which cameras of `shown` are of the group."""


def groups_of_pair(dataset: Dataset) -> list[Group]:
    """Each camera, and both."""
    tried: tuple[tuple[CameraName, ...], ...] = (CAMERAS[:1], CAMERAS[1:], CAMERAS)
    return [Group(roles, dataset, roles) for roles in tried]


def readings_of_cameras(data: Given, groups: Sequence[Group]) -> Iterator[Reading[Given]]:
    """Readings of the camera files and of the targets' labels, tried with all data."""
    for group in groups:
        if group.roles == SECONDARY:
            yield _opposite(data, group)
    # The lens of a mirrored camera is mirrored too, so that the images tell by its centre alone.
    if isinstance(data, Dataset) and run_counter_clockwise(data):
        for reading in _mirrored(data, CAMERAS):
            yield replace(reading, is_likely=True)
    cameras = cameras_of(data)
    for names in (group.names for group in groups):
        yield Reading(
            f"The {whose(data, names)} distortion coefficients seem to have the wrong sign",
            INVERSE,
            partial(with_changed, data, names, _negated),
            names,
        )
    for names in (group.names for group in groups):
        if all(_has_other_model(cameras[name]) for name in names):
            yield Reading(
                f"The {whose(data, names)} four distortion coefficients seem to be of the other "
                "lens model (k1 k2 k3 k4 of a fisheye, k1 k2 p1 p2 of the usual lens)",
                "Give the camera file again, and state which they are.",
                partial(with_changed, data, names, _of_other_model),
                names,
            )
    for names in (group.names for group in groups):
        if (factor := _size_factor([cameras[name] for name in names])) is not None:
            width, height = cameras[names[0]].image_size
            theirs = "theirs" if len(names) > 1 else f"{width}x{height} px"
            yield Reading(
                f"The {whose(data, names)} matrix K seems to be that of an image "
                f"{rounded(factor, 3)} times as large as {theirs}",
                FOR_SIZE,
                partial(with_changed, data, names, partial(scaled, factor=1.0 / factor)),
                names,
            )


def _opposite(data: Given, group: Group) -> Reading[Given]:
    """The ends of a bar exchanged in one camera, or a board turned by half a turn."""
    board, rigid_object = group.shown.board, group.shown.correspondences.rigid_object
    turned = np.array([1, 0]) if rigid_object is None else rigid_object.half_turn
    claim = f"The corners of {of_which(data, group.names)} seem to be counted from the opposite"
    which = of_which(data, group.names, "one of the cameras")
    return Reading(
        f"A and B seem to be exchanged in {which}, in all frames"
        if board is None
        else f"{claim} corner of the board",
        f"Exchange the two targets of {of_which(data, group.names)}."
        if board is None
        else COUNT_ALIKE,
        partial(with_targets, data, group.names[0], turned),
        group.names,
    )


def _mirrored(data: Given, names: tuple[str, ...]) -> Iterator[Reading[Given]]:
    """u, v or both counted from the other side; both where other cameras tell it."""
    which, alone = of_which(data, names), len(names) == 1
    one_of_two = alone and isinstance(data, Dataset)
    for axes, claim, remedy, shows in (
        (
            [0],
            f"The images of {which} seem to be mirrored: u is counted from the right",
            "Mirror them back, or replace u by the width - 1 - u.",
            "images of writing show",
        ),
        (
            [1],
            f"v of {which} seems to be counted from below",
            "Replace it by the height - 1 - v.",
            "a point near the ground shows",
        ),
        (
            [0, 1],
            f"The images of {which} seem to be turned by half a turn",
            "Turn them back, or give the camera file of the turned images.",
            "",
        ),
    ):
        if len(axes) == 1 or (alone and not one_of_two):
            told = remedy + one_of_two * f" Which camera it is, {shows}."
            whole = "Give the images, or their points, as recorded."
            corrected = partial(with_pixels, data, names, partial(_from_other_side, axes=axes))
            yield Reading(claim, told if alone else whole, corrected, names)


def readings_of_points(data: Given, groups: Sequence[Group]) -> Iterator[Reading[Given]]:
    """Readings of the table of points, tried where the data do not fit."""
    for names in (group.names for group in groups):
        if len(names) == 1 or isinstance(data, Recording):
            yield from _mirrored(data, names)
    for names in (group.names for group in groups):
        yield Reading(
            f"u and v of {of_which(data, names)} seem to be exchanged",
            "Exchange its two columns, as where rows stand before columns.",
            partial(with_pixels, data, names, _transposed),
            names,
        )
    for group in groups:
        board = group.shown.board
        if board is None or group.roles != SECONDARY:
            continue
        grid = np.arange(len(board.points)).reshape(board.rows, board.columns)
        by_columns = np.arange(len(board.points)).reshape(board.columns, board.rows).T
        for numbers, how in (
            (grid[:, ::-1], "from the other end of each row"),
            (grid[::-1], "from the last row"),
            (by_columns, "column by column"),
            (by_columns[::-1, ::-1], "column by column, from the opposite corner"),
        ):
            yield Reading(
                f"The corners of {of_which(data, group.names)} seem to be counted {how}",
                COUNT_ALIKE,
                partial(with_targets, data, group.names[0], numbers.ravel()),
                group.names,
            )
    if isinstance(data, Dataset) and data.correspondences.rigid_object is None:
        yield Reading(
            "The columns of the table seem to stand camera by camera: A and B of one camera, then "
            "those of the other",
            "Put them in the order A of both cameras, B of both cameras, or name the columns.",
            partial(_camera_by_camera, data),
            CAMERAS,
        )


def exchanged_files(
    data: Given, about: Iterable[str], cameras: Mapping[str, Camera]
) -> Iterator[Reading[Given]]:
    """Any two cameras with the file, or with the points, of each other.

    Args:
        about: at least one of the two.
        cameras: all, of which the data may have some.
    """
    for a, b in combinations(cameras, 2):
        one, other = cameras[a], cameras[b]
        if same_lens(one, other) or not {a, b} & {*about}:
            continue
        files = {
            a: replace(other, image_size=one.image_size),
            b: replace(one, image_size=other.image_size),
        }
        here = {name: file for name, file in files.items() if name in cameras_of(data)}
        alone = isinstance(data, Dataset)
        which = "two camera files" if alone else f"camera files of {a} and {b}, or their points,"
        yield Reading(
            f"The {which} seem to be exchanged",
            "Exchange the files." if alone else "Exchange them.",
            partial(with_files, data, here),
            tuple(here),
        )


def readings_of_frames(
    data: Given, name: str, shifts: Iterable[int], least_gain: float = 0.0
) -> Iterator[Reading[Given]]:
    """Readings of the numbers of one camera's frames, tried where the data do not fit.

    Args:
        name: of two the secondary.
        shifts: by how many frames they may be counted too high.
        least_gain: of the shifts.
    """
    which = of_which(data, (name,))
    if isinstance(data, Dataset):
        frames, board, cameras = data.correspondences.frames, data.board, COUNTED
    else:
        frames, board = np.unique(data.frame), data.object.board
        cameras = which, "its", "the others'"
    for order in orders_of_words(frames):
        yield Reading(
            f"The frames of {which} seem to be in the order of words (1, 10, 11, ... 2, 20)",
            "Sort its files by their numbers, or write these with zeros before: 01, 02, ...",
            partial(with_frames, data, name, frames, np.array(order)),
            (name,),
        )
    fewest = FEWEST_TO_SHIFT if board is None else FEWEST_BOARDS
    for whole in shifts if len(frames) > fewest else ():
        claim, remedy = counted_apart(frames, whole, cameras)
        corrected = partial(with_frames, data, name, frames, frames - whole)
        yield Reading(claim, remedy, corrected, (name,), least_gain=least_gain)


COUNTED = "the two cameras", "the secondary's", "the primary's"


def counted_apart(
    frames: IntArray, whole: int, cameras: tuple[str, str, str] = COUNTED
) -> tuple[str, str]:
    """The claim and the remedy where a camera's frames are counted so many too high.

    Args:
        cameras: of which the frames are apart, whose are too high, and whose are not.
    """
    frame = int(frames[min(max(whole, 0), len(frames) - 1)])
    which, own, others = cameras
    return (
        f"The frames of {which} seem to be counted {abs(whole)} apart: {own} "
        f"frame {frame - whole} is of the same moment as {others} frame {frame}",
        "Correct the numbers: one camera has an image less, or one more, at its start.",
    )


def orders_of_words(frames: IntArray) -> Iterator[list[int]]:
    """Which frame's points stand in the place of each frame, if they were counted from 0, from 1 or
    as they are, and the inverse of each order."""
    count, seen = len(frames), set[tuple[int, ...]]()
    for numbers in (frames.tolist(), range(count), range(1, count + 1)):
        order = sorted(range(count), key=lambda place: str(numbers[place]))
        for places in (order, np.argsort(order).tolist()):
            if tuple(places) not in seen and places != list(range(count)):
                seen.add(tuple(places))
                yield frames[places].tolist()


def _from_other_side(points: FloatArray, camera: Camera, axes: Sequence[int]) -> FloatArray:
    """Points (n, 2) of an image with u (axis 0), v (1) or both counted from the other side."""
    points = points.copy()
    points[:, axes] = np.array(camera.image_size)[axes] - 1 - points[:, axes]
    return points


def _transposed(points: FloatArray, _: Camera) -> FloatArray:
    return points[:, ::-1]


def _camera_by_camera(dataset: Dataset) -> Dataset:
    return replace(dataset, correspondences=dataset.correspondences.camera_by_camera())


def _size_factor(cameras: Sequence[Camera]) -> float | None:
    """How many times as large as theirs the images of all their matrices are; None where they are
    not, or not alike."""
    factors = [camera.size_factor for camera in cameras]
    logs = [np.log(factor) for factor in factors if factor is not None]
    if len(logs) < len(cameras) or np.ptp(logs) > np.log(SIZE_FACTOR_TOLERANCE):
        return None
    return float(np.exp(np.mean(logs)))


def _has_other_model(camera: Camera) -> bool:
    """Whether the lens has just the four coefficients that the other model has too."""
    return camera.is_fisheye or bool(camera.distortion.size == 4 and camera.distortion.any())


def _of_other_model(camera: Camera) -> Camera:
    model: LensModel = "brown" if camera.is_fisheye else "fisheye"
    return Camera(camera.K, camera.distortion[:4], camera.image_size, model=model)


def _negated(camera: Camera) -> Camera:
    return replace(camera, distortion=-camera.distortion)
