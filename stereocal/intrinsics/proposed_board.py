"""What is printed on the board in the first photographs, for the user to accept."""

import itertools
from collections import Counter
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from stereocal.detection.intensity import eight_bits
from stereocal.errors import StereocalError
from stereocal.intrinsics.board_corners import LARGE_PX, are_crossings, halved, outer_squares
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.system.photograph import read_photograph
from stereocal.system.photograph_files import Photographs

LOOKED_AT = 6
FEWEST_MARKERS = 6
"""Of a ChArUco board; fewer may be tags, or none."""
MOST_SQUARES = 20
FITTING = 0.15
"""Largest RMS distance of markers from where a board has them, in squares."""
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


def proposed_board(photographs: Photographs, least: float = 0.0) -> ProposedBoard | None:
    """The board that most of the first photographs show.

    Args:
        least: part of the photographs that must show it.

    Returns:
        None if they show none, or do not agree.
    """
    names = sorted(photographs)
    chosen = names[:: max(len(names) // LOOKED_AT, 1)][:LOOKED_AT]
    found: Counter[ProposedBoard] = Counter()
    for name in chosen:
        try:
            grey = eight_bits(read_photograph(photographs[name]))
        except StereocalError:  # reported by the search
            continue
        board = _charuco(grey) or _chessboard(grey)
        found.update([board] if board else [])
    best = found.most_common(2)
    if not best or (len(best) > 1 and best[0][1] == best[1][1]):
        return None
    board, count = best[0]
    return board if count >= least * len(chosen) else None


def _chessboard(grey: npt.NDArray[np.uint8]) -> ProposedBoard | None:
    """At least as many columns as rows.

    The finder takes large 2x2 targets, whose edges it crosses as it likes, for a board of 4x3: at
    most 2 of its 12 corners were crossings of squares, of a board all are.
    """
    if max(grey.shape) > LARGE_PX:
        grey = halved(grey)
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, corners, meta = cv2.findChessboardCornersSBWithMeta(grey, (4, 3), flags)
    if not found:
        return None
    grid = np.asarray(corners, dtype=np.float64).reshape(*meta.shape, 2)
    spacing = min(np.linalg.norm(np.diff(grid, axis=axis), axis=2).min() for axis in (0, 1))
    crossings = are_crossings(grey, grid.reshape(-1, 2), OF_SQUARE * spacing)
    if crossings.mean() < CROSSINGS or not outer_squares(grid, grey):
        return None
    return ProposedBoard(max(meta.shape), min(meta.shape))


def _charuco(grey: npt.NDArray[np.uint8]) -> ProposedBoard | None:
    """A ChArUco board in view whole, by the places of its numbered markers."""
    seen: dict[str, tuple[IntArray, FloatArray]] = {}
    for kind in ("4X4", "5X5", "6X6", "7X7"):  # smaller dictionaries are parts of the largest
        printed = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, f"DICT_{kind}_1000"))
        found, numbers, _ = cv2.aruco.ArucoDetector(printed).detectMarkers(grey)
        if numbers is not None and len(numbers) >= FEWEST_MARKERS:
            four = np.array(found, dtype=np.float64).reshape(-1, 4, 2)
            seen[kind] = np.asarray(numbers, dtype=np.int64).ravel(), four
    if not seen:
        return None
    bits = max(seen, key=lambda kind: len(seen[kind][0]))
    shapes = itertools.product(range(4, MOST_SQUARES + 1), (0, 1))
    fits = [fit for columns, first in shapes if (fit := _fit(columns, first, *seen[bits]))]
    misfit, columns, rows, marker = min(fits, default=(np.inf, 0, 0, 0.0))
    if misfit > FITTING or rows < 4:
        return None
    most = columns * rows // 2
    names = (f"DICT_{bits}_{size}" for size in (50, 100, 250, 1000) if size >= most)
    return ProposedBoard(columns - 1, rows - 1, next(names), round(marker, 2))


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
    there = cv2.perspectiveTransform(corners.reshape(-1, 1, 2), H).reshape(-1, 4, 2)
    side = np.linalg.norm(there - np.roll(there, 1, axis=1), axis=2)
    misfit = np.linalg.norm(there.mean(axis=1) - cells, axis=1)
    rows = int(cells[:, 1].max() + 0.5)
    return float(np.sqrt((misfit**2).mean())), columns, rows, float(np.median(side))
