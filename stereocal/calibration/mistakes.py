"""Mistakes that can be made with inputs: files exchanged, images mirrored, frames in another order.

Each row says what may be wrong, where it makes sense, and how the recording reads without it. Rows
of values that are fitted are in `wrong_inputs` and `fit.readings.judge`.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from stereocal.calibration.board_numbering import run_counter_clockwise
from stereocal.calibration.corrections import (
    camera_by_camera,
    scaled,
    undistorted,
    with_changed,
    with_files,
    with_frames,
    with_pixels,
    with_targets,
)
from stereocal.calibration.reading import Group, Row, Way, Ways, words_of
from stereocal.rig.camera import CAMERAS, SIZE_FACTOR_TOLERANCE, Camera, LensModel, same_lens
from stereocal.rig.correspondences import TARGETS
from stereocal.rig.geometry import homogeneous
from stereocal.rig.recording import Recording
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

COUNT_ALIKE = "Count the corners of both cameras row by row, from the same corner of the board."
UNDISTORTED = (
    "Give the points in the images as recorded, or for {which} a file with the matrix K of the "
    "undistorted images and no distortion (coefficients 0)."
)
AS_RECORDED = "Give the images, or their points, as recorded."
COUNTED_APART = (
    "The frames of {counted} seem to be counted {apart} apart: {own} frame {frame} is of the same "
    "moment as {others_own} frame {other_frame}"
)
CORRECT_NUMBERS = "Correct the numbers: one camera has an image less, or one more, at its start."
CORRECT_FROM = (
    "Correct the numbers of its frames from there on, or calibrate with the frames before it alone."
)
FEWEST_TO_SHIFT, FEWEST_BOARDS = 8, 4
"""Frames of a bar, and of a board, of which two may be lost: two boards tell a pose and deny it."""
SHIFTS, SHIFT_GAIN = (1, -1, 2, -2, 3, -3), 4.0
"""Frames by which the numbers of a camera may be off. One that is late by a part of a frame fits
somewhat better a whole frame off."""
WATER = 1.333
"""Refractive index, of fresh water at 20 degrees; of the sea 1.34."""
INTO_WATER = "taken through a flat window into water"
"""In the message about such images."""


def counted_apart(frames: IntArray, whole: int) -> str:
    """What is wrong where the secondary camera's frames are counted too high, and what to do."""
    words = {**words_of(CAMERAS[1:], CAMERAS), **_same_moment(frames, whole)}
    return f"{COUNTED_APART.format_map(words)}. {CORRECT_NUMBERS}"


def _same_moment(frames: IntArray, whole: int) -> dict[str, str]:
    """A frame of a camera that counts too high by `whole`, and that of others, in words."""
    frame = int(frames[min(max(whole, 0), len(frames) - 1)])
    return {"apart": f"{abs(whole)}", "frame": f"{frame - whole}", "other_frame": f"{frame}"}


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


def _exchanged(recording: Recording, group: Group) -> Iterator[Way]:
    """Each of two cameras with the file of the other; for images of its own size, if these hold
    its points."""
    a, b = group.names
    one, other = recording.cameras[a], recording.cameras[b]
    if not same_lens(one, other):
        files = {
            a: replace(other, image_size=one.image_size),
            b: replace(one, image_size=other.image_size),
        }
        with_own_sizes = with_files(recording, files)
        inside = with_own_sizes.has_all_inside
        yield Way(partial(with_files, recording, files if inside else {a: other, b: one}))


def _of_size(recording: Recording, group: Group) -> Iterator[Way]:
    """The matrices for images of the cameras' own size, where all are of one as many times as
    large."""
    cameras = [recording.cameras[name] for name in group.names]
    factors = [camera.size_factor for camera in cameras]
    logs = [np.log(factor) for factor in factors if factor is not None]
    if len(logs) == len(cameras) and np.ptp(logs) <= np.log(SIZE_FACTOR_TOLERANCE):
        factor = float(np.exp(np.mean(logs)))
        width, height = cameras[0].image_size
        theirs = "theirs" if len(cameras) > 1 else f"{width}x{height} px"
        corrected = partial(
            with_changed, recording, group.names, partial(scaled, factor=1.0 / factor)
        )
        yield Way(corrected, {"factor": f"{rounded(factor, 3)}", "theirs": theirs})


def _of_lenses(change: Callable[[Camera], Camera | None]) -> Ways:
    """The camera files changed; not where one stays as it is."""

    def ways(recording: Recording, group: Group) -> Iterator[Way]:
        changed = {name: change(recording.cameras[name]) for name in group.names}
        files = {name: camera for name, camera in changed.items() if camera is not None}
        if len(files) == len(changed):
            yield Way(partial(with_files, recording, files))

    return ways


def _negated(camera: Camera) -> Camera:
    return replace(camera, distortion=-camera.distortion)


def _in_water(recording: Recording, group: Group) -> Iterator[Way]:
    """What is seen through a flat window: sin(angle in air) = `WATER` sin(angle in water), from
    the window's axis, which is taken for the camera's.

    The points are those of pinholes with `WATER` times the focal lengths, which differ from a
    camera behind a window by its distance from it only.
    """

    def change(points: FloatArray, camera: Camera) -> FloatArray:
        in_air = camera.undistort(points)
        squared = np.sum(in_air**2, axis=1, keepdims=True)
        in_water = in_air / np.sqrt(WATER**2 * (1.0 + squared) - squared)
        return np.asarray(homogeneous(in_water) @ scaled(camera, WATER, False).K[:2].T)

    lenses = (recording.cameras[name] for name in group.names)
    is_stated = recording.has_windows
    if not is_stated and all(len(group.names) > 1 and not it.is_fisheye for it in lenses):
        yield Way(partial(_pinholes_in_water, recording, group.names, change))


def _pinholes_in_water(
    recording: Recording, names: Sequence[str], change: Callable[[FloatArray, Camera], FloatArray]
) -> Recording:
    def pinhole(camera: Camera) -> Camera:
        return Camera(scaled(camera, WATER, False).K, np.zeros(4), camera.image_size)

    return with_changed(with_pixels(recording, names, change), names, pinhole)


def _height_first(camera: Camera) -> Camera | None:
    """The image's size the other way round."""
    width, height = camera.image_size
    return None if width == height else replace(camera, image_size=(height, width))


def _of_other_model(camera: Camera) -> Camera | None:
    """The four coefficients as those of the other model."""
    if not (camera.is_fisheye or (camera.distortion.size == 4 and camera.distortion.any())):
        return None
    model: LensModel = "brown" if camera.is_fisheye else "fisheye"
    return Camera(camera.K, camera.distortion[:4], camera.image_size, model=model)


def _from_other_side(*axes: int) -> Ways:
    """u (axis 0), v (1) or both counted from the other side.

    A board whose corners run counter-clockwise speaks for it, where it is of all cameras; the lens
    of a mirrored camera is mirrored too, so that the images tell it by its centre alone. Two
    cameras of which one is turned by half a turn fit as well.
    """

    def change(points: FloatArray, camera: Camera) -> FloatArray:
        points = points.copy()
        points[:, axes] = np.array(camera.image_size)[[*axes]] - 1 - points[:, axes]
        return points

    def ways(recording: Recording, group: Group) -> Iterator[Way]:
        if len(axes) == 1 or len(recording.cameras) > 2:
            is_likely = len(group.names) > 1 and run_counter_clockwise(recording)
            corrected = partial(with_pixels, recording, group.names, change)
            yield Way(corrected, is_likely=is_likely)

    return ways


def _transposed(recording: Recording, group: Group) -> Iterator[Way]:
    yield Way(partial(with_pixels, recording, group.names, lambda points, _: points[:, ::-1]))


def _quarter_turn(recording: Recording, group: Group) -> Iterator[Way]:
    """The images turned by a quarter, either way, after the lens was calibrated."""

    def clockwise(points: FloatArray, camera: Camera) -> FloatArray:
        return np.column_stack([points[:, 1], camera.image_size[1] - 1 - points[:, 0]])

    def counter_clockwise(points: FloatArray, camera: Camera) -> FloatArray:
        return np.column_stack([camera.image_size[0] - 1 - points[:, 1], points[:, 0]])

    for change in (clockwise, counter_clockwise):
        yield Way(partial(with_pixels, recording, group.names, change))


def _side_by_side(recording: Recording, group: Group) -> Iterator[Way]:
    """The camera's image is the right half of one that shows two."""

    def change(points: FloatArray, camera: Camera) -> FloatArray:
        return points - (camera.image_size[0], 0.0)

    yield Way(partial(with_pixels, recording, group.names, change))


def _counted(by_columns: bool, *steps: int) -> Ways:
    """The corners of a board in another order: row by row or column by column, forwards or
    backwards along both (`steps`, 1 or -1)."""

    def ways(recording: Recording, group: Group) -> Iterator[Way]:
        if (board := recording.object.board) is not None:
            grid = np.arange(len(board.points)).reshape(board.rows, board.columns)
            if by_columns:
                grid = np.arange(len(board.points)).reshape(board.columns, board.rows).T
            numbers = grid[:: steps[0], :: steps[1]].ravel()
            yield Way(partial(with_targets, recording, group.names[0], numbers))

    return ways


def _half_turn(of_board: bool) -> Ways:
    """The object turned by half a turn in the images of a camera."""

    def ways(recording: Recording, group: Group) -> Iterator[Way]:
        if (recording.object.board is not None) == of_board:
            turned = recording.object.half_turn
            yield Way(partial(with_targets, recording, group.names[0], turned))

    return ways


def _camera_by_camera(recording: Recording, _: Group) -> Iterator[Way]:
    if recording.object.names == TARGETS:
        yield Way(partial(camera_by_camera, recording))


def _as_words(recording: Recording, group: Group) -> Iterator[Way]:
    frames = np.unique(recording.frame)
    for order in orders_of_words(frames):
        yield Way(partial(with_frames, recording, group.names[0], frames, np.array(order)))


def _shifted(recording: Recording, group: Group) -> Iterator[Way]:
    frames = np.unique(recording.frame)
    fewest = FEWEST_TO_SHIFT if recording.object.board is None else FEWEST_BOARDS
    for whole in SHIFTS if len(frames) > fewest else ():
        corrected = partial(with_frames, recording, group.names[0], frames, frames - whole)
        yield Way(corrected, _same_moment(frames, whole))


OF_FILES = (
    Row(
        "The {two_files} seem to be exchanged",
        "Exchange {them}.",
        "two",
        _exchanged,
        "lenses that are not alike",
    ),
)
OF_CAMERAS = (
    Row(
        "A and B seem to be exchanged in {one_of}, in all frames",
        "Exchange the two targets of {which}.",
        "one",
        _half_turn(of_board=False),
        "bars and wands",
    ),
    Row(
        "The corners of {which} seem to be counted from the opposite corner of the board",
        COUNT_ALIKE,
        "one",
        _half_turn(of_board=True),
        "boards",
    ),
    Row(
        "The {whose} distortion coefficients seem to have the wrong sign",
        "Some programs write the inverse (undistorting) coefficients: export the lens in OpenCV's "
        "convention, or change the signs.",
        "each and all",
        _of_lenses(_negated),
    ),
    Row(
        "The points of {which} seem to be of undistorted images",
        UNDISTORTED,
        "each and all",
        _of_lenses(undistorted),
        "lenses with distortion",
    ),
    Row(
        f"The images of {{which}} seem to be {INTO_WATER}, where focal "
        "lengths are 1.33 times those in air",
        'State the window, which the calibration then finds: "window" in dataset.json, as '
        '{{"thickness_m": 0.01, "medium": 1.333}}, or the question on the page Data.',
        "all",
        _in_water,
        "lenses that are no fisheyes",
    ),
    Row(
        "The {whose} four distortion coefficients seem to be of the other lens model (k1 k2 k3 k4 "
        "of a fisheye, k1 k2 p1 p2 of the usual lens)",
        "Give the camera file again, and state which they are.",
        "each and all",
        _of_lenses(_of_other_model),
        "lenses with four coefficients",
    ),
    Row(
        "The {whose} matrix K seems to be that of an image {factor} times as large as {theirs}",
        "Provide K for the size of the images in which the points were measured.",
        "each and all",
        _of_size,
        "centres that are not in the middle of the image",
    ),
)
"""Tried with all data, as are the files."""
OF_POINTS = (
    Row(
        "The images of {which} seem to be mirrored: u is counted from the right",
        "Mirror them back, or replace u by the width - 1 - u.{by_writing}",
        "each",
        _from_other_side(0),
    ),
    Row(
        "v of {which} seems to be counted from below",
        "Replace it by the height - 1 - v.{by_ground}",
        "each",
        _from_other_side(1),
    ),
    Row(
        "The images of {which} seem to be turned by half a turn",
        "Turn them back, or give the camera file of the turned images.",
        "each",
        _from_other_side(0, 1),
        "three cameras and more",
    ),
    Row(
        "The images of {which} seem to be mirrored: u is counted from the right",
        AS_RECORDED,
        "all",
        _from_other_side(0),
    ),
    Row("v of {which} seems to be counted from below", AS_RECORDED, "all", _from_other_side(1)),
    Row(
        "u and v of {which} seem to be exchanged",
        "Exchange its two columns, as where rows stand before columns.",
        "each",
        _transposed,
    ),
    *(
        Row(
            f"The corners of {{which}} seem to be counted {how}",
            COUNT_ALIKE,
            "one",
            _counted(*order),
            "boards",
        )
        for how, order in (
            ("from the other end of each row", (False, 1, -1)),
            ("from the last row", (False, -1, 1)),
            ("column by column", (True, 1, 1)),
            ("column by column, from the opposite corner", (True, -1, -1)),
        )
    ),
    Row(
        "The columns of the table seem to stand camera by camera: A and B of one camera, then "
        "those of the {others}",
        "Put them in the order A of both cameras, B of both cameras, or name the columns.",
        "all",
        _camera_by_camera,
        "bars",
    ),
)
"""Tried where the data do not fit."""
OF_IMAGES = (
    Row(
        "The image size in the file of {which} seems to be given as height and width",
        "Write the width first.",
        "each and all",
        _of_lenses(_height_first),
        "images that are not square",
    ),
    Row(
        "The points of {which} seem to be counted in images that show two cameras side by side",
        "Subtract the width of one image from u, or split the images.",
        "each",
        _side_by_side,
    ),
    Row(
        "u and v of {which} seem to be exchanged",
        "Exchange the two columns, as where rows stand before columns.",
        "all",
        _transposed,
    ),
    Row(
        "The images of {which} seem to have been turned by a quarter after the lens was calibrated",
        "Turn them back, or calibrate the lens with turned images.",
        "each and all",
        _quarter_turn,
    ),
)
"""Tried where points lie outside their image, which tells them."""
OF_FRAMES = (
    Row(
        "The frames of {which} seem to be in the order of words (1, 10, 11, ... 2, 20)",
        "Sort its files by their numbers, or write these with zeros before: 01, 02, ...",
        "one",
        _as_words,
    ),
    Row(COUNTED_APART, CORRECT_NUMBERS, "one", _shifted, least_gain=SHIFT_GAIN),
)
"""Likewise; they are of all frames."""
