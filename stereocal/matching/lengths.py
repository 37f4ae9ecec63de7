"""The distance between two points of each frame, to be compared with a known length."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.trajectories import further_columns
from stereocal.rig.measured_lengths import check_length
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import count, digits, rounded

MAXIMUM_LABELS = 500
"""A column with more distinct values is a measurement, not a name."""


@dataclass(frozen=True, eq=False)
class LengthCheck:
    """Distances between two points in the m frames with both."""

    frames: IntArray
    lengths_m: FloatArray
    """(m,)."""
    known_m: float
    left_out: int
    """Frames with a duplicate of one of the two points."""

    @property
    def errors(self) -> FloatArray:
        """(m,) (measured - known) / known, a fraction."""
        errors: FloatArray = self.lengths_m / self.known_m - 1
        return errors

    @property
    def mean_error(self) -> float:
        """Mean of |measured - known| / known."""
        return float(np.abs(self.errors).mean())

    def sentence(self) -> str:
        bias, more = float(self.errors.mean()), ""
        if self.left_out:
            frames = count(self.left_out, "frame", "were")
            more = f" {frames} left out for having one of the points twice."
        return (
            f"The mean distance in {count(len(self.frames), 'frame')} is "
            f"{digits(float(self.lengths_m.mean()), 4)} m; the known length is "
            f"{rounded(self.known_m, 4)} m. "
            f"The mean error is {100 * self.mean_error:.2f} %, the mean is "
            f"{100 * abs(bias):.2f} % too {'long' if bias > 0 else 'short'}.{more}"
        )


def label_columns(points: pd.DataFrame) -> list[str]:
    """Further columns that can name points: at least two and not too many distinct values."""
    names = further_columns(points)
    return [name for name in names if 2 <= points[name].nunique() <= MAXIMUM_LABELS]


def has_two_a_frame(points: pd.DataFrame) -> bool:
    """Whether any frame has exactly two points."""
    return bool((points.groupby("frame").size() == 2).any())


def check_lengths(
    points: pd.DataFrame,
    known_m: float,
    column: str | None = None,
    ends: tuple[str, str] = ("", ""),
) -> LengthCheck:
    """Measure the distance between two points in each frame, and compare it with the known one.

    Args:
        points: a table as returned by `reconstruct`.
        column: column with the points' names; None uses the frames with exactly two points.
        ends: the names of the two points in that column.
    """
    check_length("known length", known_m)
    columns = ["frame", "x", "y", "z", *([] if column is None else [column])]
    seen = points.loc[np.isfinite(points["x"].to_numpy(dtype=np.float64)), columns]
    left_out = 0
    if column is None:
        number = seen.groupby("frame").cumcount()
        pairs = seen[seen.groupby("frame")["x"].transform("size") == 2]
        sides = [pairs[number[pairs.index] == k] for k in (0, 1)]
    else:
        if ends[0] == ends[1]:
            raise StereocalError(f"The two points are the same ({ends[0]}): choose two.")
        named = seen[column].astype(str)
        sides = [seen[named == end] for end in ends]
        twice = {f for side in sides for f in side.loc[side.duplicated("frame"), "frame"]}
        left_out = len(twice)
        sides = [side[~side["frame"].isin(list(twice))] for side in sides]
    joined = sides[0].merge(sides[1], on="frame", suffixes=("", "_other"))
    if joined.empty:
        raise StereocalError("No frame has both points, so there is no length to check.")
    both = [joined[[f"{axis}{of}" for axis in "xyz"]].to_numpy(np.float64) for of in ("", "_other")]
    lengths = np.linalg.norm(both[0] - both[1], axis=1)
    return LengthCheck(joined["frame"].to_numpy(), lengths, known_m, left_out)
