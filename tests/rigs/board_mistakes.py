"""What goes wrong with a board before two cameras, one thing at a time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stereocal.calibration.corrections import scaled
from stereocal.rig.pair import Pair
from stereocal.system.array_types import FloatArray, IntArray
from tests.rigs.board_pairs import BoardPair, seen_at
from tests.rigs.mistakes import flipped, from_below, from_the_right
from tests.rigs.pair_mistakes import (
    ANOTHER_ZOOM,
    EXCHANGED,
    OF_FISHEYES,
    ONE_FILE,
    Change,
    copied,
    lexical,
    moved,
    of_files,
    of_points,
    reordered,
    slipped,
    unrelated,
)

Spoil = Callable[[BoardPair, np.random.Generator], BoardPair]


@dataclass(frozen=True)
class BoardMistake:
    """What was done to a sound pair, and words that name it, in lower case."""

    data: Callable[[BoardPair, np.random.Generator], Pair]
    words: tuple[str, ...]
    needs_truth: bool = False


def _grid(pair: BoardPair) -> IntArray:
    return np.arange(pair.points.shape[1]).reshape(pair.board.rows, pair.board.columns)


def stated_as(pair: BoardPair, columns: int, rows: int) -> BoardPair:
    """The board stated with other numbers of corners; the table is as it was."""
    points = pair.points[:, : columns * rows]
    return replace(pair, board=replace(pair.board, columns=columns, rows=rows), points=points)


def numbered(pair: BoardPair, order: IntArray, rng: np.random.Generator) -> BoardPair:
    """The corners of one camera under other numbers."""
    points, camera = pair.points.copy(), _one(rng)
    points[:, :, camera] = pair.points[:, order.ravel(), camera]
    return replace(pair, points=points)


def _one(rng: np.random.Generator) -> int:
    return int(rng.integers(2))


def board_of(pair: BoardPair, scale: FloatArray, second_half: bool = False) -> BoardPair:
    """The printed board is larger by a factor along its columns and rows than is stated; all along
    or in the second half."""
    if pair.truth is None:  # of real corners: the stated board is changed instead
        raise NotImplementedError
    rng = np.random.default_rng(7)
    own = pair.board.points - pair.board.points.mean(axis=0)
    corners = own * np.array([*scale, 1.0])
    points = pair.points.copy()
    for frame, pose in enumerate(pair.placings):
        if second_half and frame < len(points) // 2:
            continue
        points[frame] = seen_at(pair.truth, pose, corners)
        points[frame] += pair.noise_px * rng.standard_normal(points[frame].shape)
    sizes = np.array([camera.image_size for camera in pair.cameras])
    inside = ((points > 0) & (points < sizes - 1)).all(axis=(1, 2, 3))
    return replace(pair, points=points[inside])


def cropped(pair: BoardPair, rng: np.random.Generator) -> BoardPair:
    """A tenth cut off on the left of one camera's images, and an eighteenth above."""
    which = _one(rng)
    width, height = pair.cameras[which].image_size
    points = pair.points.copy()
    points[:, :, which] -= np.array([width // 10, height // 18])
    lost = (points[:, :, which] < 0).any(axis=2)
    points[lost] = np.nan
    return replace(pair, points=points)


def square_off(pair: BoardPair, _: np.random.Generator) -> BoardPair:
    return replace(pair, board=replace(pair.board, square_m=1.1 * pair.board.square_m))


def _of_board(spoil: Spoil) -> Callable[[BoardPair, np.random.Generator], Pair]:
    return lambda pair, rng: spoil(pair, rng).dataset


def _of_pair(change: Change, *words: str) -> BoardMistake:
    """A mistake of any two cameras."""
    return BoardMistake(lambda pair, rng: change(pair.dataset, rng), words)


def _stated(columns: int, rows: int) -> Callable[[BoardPair, np.random.Generator], Pair]:
    return _of_board(lambda p, _: stated_as(p, p.board.columns + columns, p.board.rows + rows))


MISTAKES: Mapping[str, BoardMistake] = {
    "a column too many": BoardMistake(_stated(1, 0), ("columns",)),
    "a column too few": BoardMistake(_stated(-1, 0), ("columns",)),
    "rows and columns exchanged": BoardMistake(
        _of_board(lambda p, _: stated_as(p, p.board.rows, p.board.columns)), ("columns",)
    ),
    "both cameras mirrored": _of_pair(of_points(from_the_right, True), "mirrored"),
    "one camera mirrored": _of_pair(of_points(from_the_right), "mirrored"),
    "corners of one camera mirrored": BoardMistake(
        _of_board(lambda p, r: numbered(p, _grid(p)[:, ::-1], r)),
        ("from the other end of each row",),
    ),
    "corners of one camera from the last row": BoardMistake(
        _of_board(lambda p, r: numbered(p, _grid(p)[::-1], r)), ("from the last row",)
    ),
    "rows and columns exchanged in one camera": BoardMistake(
        _of_board(lambda p, r: numbered(p, _grid(p).T, r)), ("columns",)
    ),
    "half a turn of one camera": BoardMistake(
        _of_board(lambda p, r: numbered(p, _grid(p)[::-1, ::-1], r)), ("opposite corner",)
    ),
    "stretched by 1.5 %": BoardMistake(
        _of_board(lambda p, r: board_of(p, np.array([[1.015, 1.0], [1.0, 1.015]][_one(r)]))),
        ("ruler",),
        True,
    ),
    "two boards of different sizes": BoardMistake(
        _of_board(lambda p, _: board_of(p, np.array([1.2, 1.2]), second_half=True)),
        ("times as large",),
        True,
    ),
    "square 10 % too large": BoardMistake(_of_board(square_off), ("contradict each other",)),
    "moved half-way": _of_pair(moved, "a camera moved"),
    "frames in the order of words": _of_pair(reordered(lexical), "order of words"),
    "frames shifted by one": _of_pair(reordered(slipped), "counted 1 apart"),
    "K at half size": _of_pair(
        of_files(partial(scaled, factor=0.5)), "matrix k", "focal length", *OF_FISHEYES
    ),
    "a crop": BoardMistake(_of_board(cropped), ("centre", "principal point")),
    "camera files exchanged": _of_pair(EXCHANGED, "exchanged", *OF_FISHEYES),
    "one camera from below": _of_pair(of_points(from_below), "from below"),
    "both cameras from below": _of_pair(of_points(from_below, True), "from below", "mirrored"),
    "u and v exchanged in one camera": _of_pair(
        of_points(lambda points, _: points[:, ::-1]), "u and v"
    ),
    "one camera's points of half size": _of_pair(
        of_points(lambda points, _: 0.5 * points), "images of about"
    ),
    "all points at 75 %": _of_pair(
        of_points(lambda points, _: 0.75 * points, True), "images of about"
    ),
    "K of both at half size": _of_pair(
        of_files(partial(scaled, factor=0.5), True), "matrix k", "k seems", *OF_FISHEYES
    ),
    "K at twice the size": _of_pair(of_files(partial(scaled, factor=2.0)), "matrix k"),
    "distortion of one camera of the other sign": _of_pair(of_files(flipped), "distortion"),
    "distortion of both of the other sign": _of_pair(of_files(flipped, True), "distortion"),
    "file of another zoom": _of_pair(ANOTHER_ZOOM, "focal length"),
    "one file for both cameras": _of_pair(ONE_FILE, "same lens"),
    "frames in no order": _of_pair(unrelated, "None of these explains it"),
    "half of the frames copied": _of_pair(partial(copied, share=0.5), "exactly those of"),
}
