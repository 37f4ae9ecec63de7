"""Compare the measured distance between two points of each frame with a known length."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.reconstruction_files import (
    COORDINATES,
    OUTSIDE_VOLUME,
    POINT_COLUMNS,
    SIGMA_COLUMNS,
)
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.dataset import check_length
from stereocal.system.numbers import rounded

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
        """The result of the check."""
        more = (
            f" {self.left_out} frames were left out because they have one of the points twice."
            if self.left_out
            else ""
        )
        bias = float(self.errors.mean())
        return (
            f"The mean distance in {len(self.frames)} frames is {self.lengths_m.mean():.4f} m; the "
            f"known length is {rounded(self.known_m, 4)} m. The mean error is "
            f"{100 * self.mean_error:.2f} %, the mean is {100 * abs(bias):.2f} % too "
            f"{'long' if bias > 0 else 'short'}.{more}"
        )


def further_columns(points: pd.DataFrame) -> list[str]:
    """The columns that were passed through."""
    own = {*POINT_COLUMNS, *SIGMA_COLUMNS, OUTSIDE_VOLUME, COORDINATES, "ambiguous"}
    return [str(name) for name in points.columns if name not in own]


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
        twice = set[int]()
        for side in sides:
            twice |= set(side.loc[side.duplicated("frame", keep=False), "frame"])
        left_out = len(twice)
        sides = [side[~side["frame"].isin(list(twice))] for side in sides]
    joined = sides[0].merge(sides[1], on="frame", suffixes=("", "_other"))
    if joined.empty:
        raise StereocalError("No frame has both points, so there is no length to check.")
    first = joined[["x", "y", "z"]].to_numpy(dtype=np.float64)
    second = joined[["x_other", "y_other", "z_other"]].to_numpy(dtype=np.float64)
    lengths = np.linalg.norm(first - second, axis=1)
    return LengthCheck(joined["frame"].to_numpy(), lengths, known_m, left_out)
