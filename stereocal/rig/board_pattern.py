"""The pattern printed on a board: a chessboard or a ChArUco board."""

import re
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.compiled import FloatArray

DICTIONARIES = tuple(
    f"DICT_{bits}_{count}"
    for bits in ("4X4", "5X5", "6X6", "7X7")
    for count in (50, 100, 250, 1000)
)
LARGEST_BOARD_M = 5.0
"""Boards are carried about; a square entered in centimetres gives more."""
_SIZE = re.compile(r"\s*(\d{1,3})\s*[xX×*,]\s*(\d{1,3})\s*")


@dataclass(frozen=True)
class BoardPattern:
    """What is printed on the board.

    Args:
        columns, rows: inner corners, where four squares meet: one less than squares.
        square_m: side of a square.
        dictionary: name of a ChArUco board's dictionary (`DICTIONARIES`); None for a chessboard.
        marker_m: side of a ChArUco board's markers.
    """

    columns: int
    rows: int
    square_m: float
    dictionary: str | None = None
    marker_m: float | None = None

    def __post_init__(self) -> None:
        if min(self.columns, self.rows) < 3 or max(self.columns, self.rows) > 100:
            raise StereocalError(
                f"A board of {self.columns}x{self.rows} inner corners cannot be used: it needs 3 "
                "to 100 each way. Inner corners are where four squares meet."
            )
        if not (np.isfinite(self.square_m) and self.square_m > 0):
            raise StereocalError(f"The side of a square must be above 0, not {self.square_m:g} m.")
        widest = self.square_m * (max(self.columns, self.rows) + 1)
        if widest > LARGEST_BOARD_M:
            raise StereocalError(
                f"The side of a square is {self.square_m:g} m, and the board {widest:.3g} m wide: "
                "this looks like centimetres or millimetres. Give it in metres "
                f"({self.square_m / 100:g} or {self.square_m / 1000:g})."
            )
        if self.dictionary is None:
            return
        if self.dictionary not in DICTIONARIES:
            raise StereocalError(
                f'The ChArUco dictionary "{self.dictionary}" is not known: use one of '
                f"{DICTIONARIES[0]}, {DICTIONARIES[1]}, ... {DICTIONARIES[-1]}."
            )
        if self.marker_m is None or not 0 < self.marker_m < self.square_m:
            raise StereocalError(
                "A ChArUco board needs the side of its markers: above 0 and below that of its "
                "squares."
            )
        markers = (self.columns + 1) * (self.rows + 1) // 2
        if markers > int(self.dictionary.rsplit("_", 1)[1]):
            raise StereocalError(
                f"A ChArUco board of {self.columns}x{self.rows} inner corners has {markers} "
                f"markers, more than {self.dictionary} contains."
            )

    @classmethod
    def parse(
        cls,
        size: str,
        square_m: float,
        dictionary: str | None = None,
        marker_m: float | None = None,
    ) -> "BoardPattern":
        """The board with a size such as `18x12`, in inner corners."""
        found = _SIZE.fullmatch(size)
        if found is None:
            raise StereocalError(
                f'The size of the board is "{size}": write the numbers of inner corners like 18x12.'
            )
        return cls(int(found[1]), int(found[2]), square_m, dictionary, marker_m)

    @cached_property
    def points(self) -> FloatArray:
        """(n, 3): the inner corners in metres, row by row, z = 0."""
        grid = np.stack(np.meshgrid(np.arange(self.columns), np.arange(self.rows)), axis=-1)
        flat = self.square_m * grid.reshape(-1, 2).astype(np.float64)
        return np.column_stack([flat, np.zeros(len(flat))])

    @property
    def reach(self) -> float:
        """Distance around a corner with only its own edges printed, in squares, at most 0.4."""
        if self.marker_m is None or self.dictionary is None:
            return 0.4
        return min(0.4, 0.5 * (1.0 - self.marker_m / self.square_m))

    def __str__(self) -> str:
        return f"{self.columns}x{self.rows}"
