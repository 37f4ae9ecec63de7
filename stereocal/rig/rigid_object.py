"""What is moved in front of the cameras: a rigid object with known points.

A bar with two targets is the smallest one; a wand with three markers and a board are others.
"""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial import KDTree

from stereocal.errors import StereocalError
from stereocal.system.arguments import checked
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.names import check_name

DICTIONARIES = tuple(
    f"DICT_{bits}_{count}"
    for bits in ("4X4", "5X5", "6X6", "7X7")
    for count in (50, 100, 250, 1000)
)
LARGEST_BOARD_M = 5.0
"""Boards are carried about; a square entered in centimetres gives more."""
_SIZE = re.compile(r"\s*(\d{1,3})\s*[xX×*,]\s*(\d{1,3})\s*")
MOST_PAIRS = 2
"""Distances taken of one placing of an object. The points of a board share its bend and its print:
with 99 overlapping distances a board, stated errors are 4.6 to 11 times too small, with one or two
disjoint ones they are true."""

MOST_POINTS = 10_000
"""The number that the largest board has."""
ALIKE = 1e-6
"""The share of its size by which an object that looks the same when turned may differ."""
FEWEST_TO_PLACE = 4
"""Points of an object in one image."""
COLLINEAR = 0.05
"""Points closer to a line than this share of their length do not tell how they are turned."""
ONE_PLACE = 1e-4
"""Rays no farther apart are of one place, about 0.1 px, where OpenCV raises an error."""


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
    @checked
    def parse(
        cls,
        size: str,
        square_m: float,
        dictionary: str | None = None,
        marker_m: float | None = None,
    ) -> "BoardPattern":
        """The board with a size such as `18x12`, in inner corners."""
        match = _SIZE.fullmatch(size)
        if match is None:
            raise StereocalError(
                f'The size of the board is "{size}": write the numbers of inner corners like 18x12.'
            )
        return cls(int(match[1]), int(match[2]), square_m, dictionary, marker_m)

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


@dataclass(frozen=True, eq=False)
class RigidObject:
    """Points that move together, in the object's own frame."""

    names: tuple[str, ...]
    points: FloatArray
    """(k, 3), in metres."""
    sigma_m: float | None = None
    """Standard error of its distances; None if not stated."""
    board: BoardPattern | None = None
    """The pattern whose inner corners these are, named 0, 1, ... row by row."""

    def __post_init__(self) -> None:
        if not 2 <= len(self.names) <= MOST_POINTS or self.points.shape != (len(self.names), 3):
            raise StereocalError(
                f"An object needs 2 to {MOST_POINTS} points, each with three numbers."
            )
        for name in self.names if self.board is None else ():
            check_name("A target", name)
        if len({*self.names}) < len(self.names):
            raise StereocalError("Two points of the object have the same name.")
        if not np.isfinite(self.points).all():
            raise StereocalError("A point of the object is not a finite number.")
        first, counts = np.unique(self.points, axis=0, return_index=True, return_counts=True)[1:]
        if (counts > 1).any():
            one = int(first[counts > 1][0])
            other = np.flatnonzero((self.points == self.points[one]).all(axis=1))[1]
            raise StereocalError(
                f"The points {self.names[one]} and {self.names[other]} of the object are at the "
                "same place."
            )

    @classmethod
    def bar(cls, distance_m: float, sigma_m: float | None = None) -> "RigidObject":
        """Two targets A and B."""
        return cls(("A", "B"), np.array([[0.0, 0.0, 0.0], [distance_m, 0.0, 0.0]]), sigma_m)

    @classmethod
    def of_board(cls, board: BoardPattern, sigma_m: float | None = None) -> "RigidObject":
        """The inner corners of a board."""
        return cls(tuple(map(str, range(len(board.points)))), board.points, sigma_m, board)

    @classmethod
    def of(cls, what: "Held") -> "RigidObject":
        """The object from a length A-B in metres, points by name, or a board."""
        if isinstance(what, RigidObject):
            return what
        if isinstance(what, BoardPattern):
            return cls.of_board(what)
        if isinstance(what, Mapping):
            points = np.array([*what.values()], dtype=np.float64)
            return cls(tuple(map(str, what)), points.reshape(len(what), -1))
        return cls.bar(float(what))

    @property
    def word(self) -> str:
        """What it is called in messages."""
        if self.board is not None:
            return "board"
        return "bar" if len(self.names) == 2 else "object"

    def distance(self, one: IntArray | int, other: IntArray | int) -> FloatArray:
        """Distances between points by their indices, in metres, in the shape of the indices."""
        return np.asarray(np.linalg.norm(self.points[one] - self.points[other], axis=-1))

    def pairs_among(self, seen: Iterable[int]) -> IntArray:
        """(p, 2): disjoint pairs of the points seen with the longest distances, at most two.

        Of a bar or a wand of three these are its two ends, of a board its two diagonals.
        """
        left = np.array(sorted({*seen}), dtype=np.int64)
        pairs: list[IntArray] = []
        while len(left) > 1 and len(pairs) < MOST_PAIRS:
            pairs.append(self._farthest(left))
            left = np.setdiff1d(left, pairs[-1])
        return np.array(pairs, dtype=np.int64).reshape(-1, 2)

    def parts_of(self, frame: IntArray, target: IntArray) -> tuple[IntArray, IntArray]:
        """(n,) each: as of `Correspondences.parts`, of the rows of some targets in some frames."""
        if len(self.names) == 2:
            return parts_of_bars(frame, target)
        part, place, count = np.empty_like(frame), np.zeros_like(frame), 0
        order = np.lexsort([target, frame])
        parts_of_seen: dict[bytes, tuple[IntArray, IntArray]] = {}
        for rows in np.split(order, np.flatnonzero(np.diff(frame[order])) + 1):
            seen = target[rows]
            key = seen.tobytes()
            if key not in parts_of_seen:
                pairs = np.searchsorted(seen, self.pairs_among(seen.tolist()))
                single = np.setdiff1d(np.arange(len(seen)), pairs)
                parts, places = np.zeros((2, len(seen)), np.int64)
                parts[pairs], places[pairs] = np.arange(len(pairs))[:, None], [0, 1]
                parts[single] = len(pairs) + np.arange(len(single))
                parts_of_seen[key] = parts, places
            parts, place[rows] = parts_of_seen[key]
            part[rows] = count + parts
            count += len(parts) - int(place[rows].sum())
        return part, place

    def _farthest(self, among: IntArray) -> IntArray:
        """(2,): the two points that are farthest apart; the first such pair if there are several.

        A distance is at most the sum of those of its ends from the middle of the points, so that
        of a board only the corners are compared.
        """
        points = self.points[among]
        radius = np.linalg.norm(points - 0.5 * (points.min(axis=0) + points.max(axis=0)), axis=1)
        far = points[np.argmax(radius)]
        at_least = np.max(np.linalg.norm(points - far, axis=1))
        among = among[radius + np.max(radius) >= (1.0 - ALIKE) * at_least]
        longest, best = -1.0, among[:2]
        for k, one in enumerate(among[:-1]):
            distances = self.distance(one, among[k + 1 :])
            if distances.max() > longest:
                longest, best = distances.max(), among[[k, k + 1 + int(distances.argmax())]]
        return best

    @cached_property
    def half_turn(self) -> IntArray:
        """(k,): which target each is taken for when the object is turned the other way.

        A board is rotated by 180 degrees; of an object that is not alike then, such as a wand, the
        two ends are exchanged.
        """
        order = np.arange(len(self.names))
        turned = self.points.min(axis=0) + self.points.max(axis=0) - self.points
        away, nearest = KDTree(self.points).query(turned)
        if np.max(away) < ALIKE * self.longest_m:
            return np.asarray(nearest, dtype=np.int64)
        one, other = self.longest
        order[[one, other]] = other, one
        return order

    @cached_property
    def longest(self) -> tuple[int, int]:
        """The two points that are farthest apart."""
        one, other = self._farthest(np.arange(len(self.names))).tolist()
        return one, other

    @property
    def longest_m(self) -> float:
        """Their distance, in metres."""
        return float(self.distance(*self.longest))


def parts_of_bars(frame: IntArray, target: IntArray) -> tuple[IntArray, IntArray]:
    """(n,) each: as of `Correspondences.parts`, of rows of the ends 0 and 1 of a bar."""
    part = np.searchsorted(np.unique(frame), frame)
    alone = np.bincount(part)[part] == 1
    return part, np.where(alone, 0, target)


def placed(frame: IntArray, points: FloatArray, rays: FloatArray) -> FloatArray:
    """An object's points (n, 3) in the frame of a camera, from its image alone, in metres.

    NaN where too few are seen.

    Args:
        frame: (n,).
        points: (n, 3), in the object's own frame, in metres.
        rays: (2, n), undistorted and normalised.
    """
    camera_points = np.full_like(points, np.nan)
    for one in np.unique(frame):
        rows = np.flatnonzero(frame == one)
        object_points, seen = points[rows], np.ascontiguousarray(rays[:, rows].T)
        spread = np.linalg.svd(object_points - object_points.mean(axis=0), compute_uv=False)
        at_one_place = np.ptp(seen, axis=0).max() < ONE_PLACE
        if len(rows) < FEWEST_TO_PLACE or spread[1] < COLLINEAR * spread[0] or at_one_place:
            continue
        # SQPnP takes four points, in a plane or not; ITERATIVE wants six that are not.
        solved, turn, shift = cv2.solvePnP(
            object_points, seen, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP
        )
        if solved:
            turn, shift = cv2.solvePnPRefineLM(object_points, seen, np.eye(3), None, turn, shift)
            camera_points[rows] = object_points @ cv2.Rodrigues(turn)[0].T + shift.T
    return camera_points


Held = float | Mapping[str, Iterable[float]] | BoardPattern | RigidObject
"""What a script says is held: a length A-B in metres, points by name in metres, or a board."""
