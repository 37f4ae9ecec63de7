"""What is printed on the board in the first photographs, for the user to accept."""

import itertools
import math
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.candidates import are_many
from stereocal.detection.intensity import eight_bits, normalise_intensity
from stereocal.errors import StereocalError
from stereocal.intrinsics.board_corners import (
    FINDER_SEED,
    LARGE_PX,
    are_crossings,
    halved,
    outer_squares,
    plain_squares,
)
from stereocal.intrinsics.markers import Markers, markers_in
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.photograph import read_photograph
from stereocal.system.photograph_files import Photographs
from stereocal.system.split_photographs import Split, halves_of, split_by_shape

LOOKED_AT, UNTIL = 6, 3
"""Photographs, and those until none of which shows a board in both halves."""
FEWEST_MARKERS = 6
"""On a ChArUco board; fewer may be tags, or none."""
MOST_SQUARES = 20
FITTING = 0.15
"""Largest RMS distance of markers from where a board has them, in squares."""
SMALLEST = 4, 3
"""Inner corners of the smallest chessboard that is looked for."""
CROSSINGS, OF_SQUARE = 0.75, 0.3
"""Least part of the corners that must be crossings of squares, and how far from them, in squares,
this is looked at."""


@dataclass(frozen=True)
class ProposedBoard:
    """Inner corners of a board, and the markers of a ChArUco board."""

    columns: int
    rows: int
    dictionary: str | None = None
    marker: float = 0.0
    """Side of a marker over that of a square."""

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"

    @property
    def size(self) -> tuple[int, int | str]:
        """What two share that may be one board: of a ChArUco board, the last rows of markers may
        not be read."""
        if self.dictionary is None:
            return self.columns, self.rows
        return self.columns, self.dictionary.rpartition("_")[0]


def proposed_board(photographs: Photographs) -> ProposedBoard | None:
    """The board that most of the first photographs show.

    Returns:
        None if they show none, or do not agree.
    """
    votes: Counter[ProposedBoard] = Counter()
    for grey in _first(photographs):
        seen = _board_in(grey)
        votes.update([seen[0]] if seen else [])
    best = votes.most_common(2)
    if not best or (len(best) > 1 and best[0][1] == best[1][1]):
        return None
    return best[0][0]


def _first(photographs: Photographs) -> Iterator[npt.NDArray[np.uint8]]:
    """Some of the photographs, in 8 bits of grey."""
    names = sorted(photographs)
    for name in names[:: max(len(names) // LOOKED_AT, 1)][:LOOKED_AT]:
        with suppress(StereocalError):  # reported by the search
            yield eight_bits(read_photograph(photographs[name]))


def _board_in(grey: npt.NDArray[np.uint8]) -> tuple[ProposedBoard, FloatArray] | None:
    return charuco_of(markers_in(grey)) or chessboard_in(grey)


def split_of(photographs: Photographs) -> Split | None:
    """How the images of two cameras lie in each photograph; None unless their shape allows it, and
    the first ones show the same board in both halves."""
    twice = 0
    for looked_at, grey in enumerate(_first(photographs)):
        if looked_at == UNTIL and not twice:
            break
        if (split := split_by_shape((grey.shape[1], grey.shape[0]))) is None:
            return None
        seen = [_board_in(eight_bits(half)) for half in halves_of(grey, split)]
        one, other = (board and board[0].size for board in seen)
        twice += one is not None and one == other
        if twice >= min(2, len(photographs)):
            return split
    return None


def chessboard_in(grey: npt.NDArray[np.uint8]) -> tuple[ProposedBoard, FloatArray] | None:
    """A chessboard, with at least as many columns as rows, and its inner corners (n, 2) px.

    The finder takes large 2x2 targets, whose edges it crosses as it likes, for a board of 4x3: at
    most 2 of its 12 corners were crossings of squares, of a board all are. It takes 0.1 to 0.3 s
    where there is no board; a photograph with too few crossings for one is therefore not searched.
    """
    scale = 1.0
    if max(grey.shape) > LARGE_PX:
        grey, scale = halved(grey), 2.0
    if not are_many(normalise_intensity(grey).image, int(CROSSINGS * math.prod(SMALLEST))):
        return None
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    cv2.setRNGSeed(FINDER_SEED)
    is_found, corners, meta = cv2.findChessboardCornersSBWithMeta(grey, SMALLEST, flags)
    if not is_found:
        return None
    grid = np.asarray(corners, dtype=np.float64).reshape(*meta.shape, 2)
    spacing = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
    crossings = are_crossings(grey, grid.reshape(-1, 2), OF_SQUARE * spacing)
    if crossings.mean() < CROSSINGS or not (
        outer_squares(grid, grey) and plain_squares(grid, grey)
    ):
        return None
    raw = scale * grid.reshape(-1, 2) + 0.5 * (scale - 1.0)
    return ProposedBoard(max(meta.shape), min(meta.shape)), raw


def charuco_of(markers: Markers) -> tuple[ProposedBoard, FloatArray] | None:
    """A ChArUco board in view whole, by the places of its numbered markers, and the centres (n, 2)
    px of these."""
    seen = {
        name: numbered
        for name, numbered in markers.items()
        if len(numbered[0]) >= FEWEST_MARKERS and "X" in name
    }
    if not seen:
        return None
    best = max(seen, key=lambda name: len(seen[name][0]))
    shapes = itertools.product(range(4, MOST_SQUARES + 1), (0, 1))
    fits = [fit for columns, first in shapes if (fit := _fit(columns, first, *seen[best]))]
    misfit, columns, rows, marker = min(fits, default=(np.inf, 0, 0, 0.0))
    if misfit > FITTING or rows < 4:
        return None
    name = f"DICT_{smallest_dictionary(best, columns * rows // 2)}"
    board = ProposedBoard(columns - 1, rows - 1, name, round(marker, 2))
    return board, seen[best][1].mean(axis=1)


def smallest_dictionary(name: str, markers: int) -> str:
    """The smallest dictionary that is a part of the named one and has so many markers."""
    bits, _, size = name.partition("_")
    if not size.isdigit():
        return name
    return f"{bits}_{next((size for size in (50, 100, 250) if size >= markers), 1000)}"


def _fit(
    columns: int, first: int, ids: IntArray, corners: FloatArray
) -> tuple[float, int, int, float] | None:
    """How well markers (n, 4, 2) fit a board with so many squares a row; `first` is 1 if its first
    square has a marker, as before OpenCV 4.6.

    RMS distance in squares, columns, rows, and the side of a marker in squares; None if the markers
    are not spread over the board.
    """
    squares = np.arange(2 * (ids.max() + columns))
    row, column = np.divmod(squares, columns)
    cells = np.column_stack([column, row])[(row + column) % 2 != first][ids] + 0.5
    if np.ptp(cells, axis=0).min() < 2:
        return None
    seen = corners.mean(axis=1)
    H, _ = cv2.findHomography(seen, cells)
    if H is None:
        return None
    on_board = cv2.perspectiveTransform(corners.reshape(-1, 1, 2), H).reshape(-1, 4, 2)
    side = np.linalg.norm(on_board - np.roll(on_board, 1, axis=1), axis=2)
    misfit = np.linalg.norm(on_board.mean(axis=1) - cells, axis=1)
    rows = int(cells[:, 1].max() + 0.5)
    return float(np.sqrt((misfit**2).mean())), columns, rows, float(np.median(side))
