"""What a table of 3D points shows: the distance between two points of each frame, to be compared
with a known length, and trajectories: points of the same name, or the only point of each frame, in
successive frames."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from stereocal.errors import StereocalError
from stereocal.matching.measure_tables import (
    COORDINATES,
    OUTSIDE_VOLUME,
    POINT_COLUMNS,
    SIGMA_COLUMNS,
)
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.dataset import check_length
from stereocal.system.numbers import count, rounded

MAXIMUM_LABELS = 500
"""A column with more distinct values is a measurement, not a name."""
ONE_A_FRAME = "the point of each frame"
ROWS_PER_TRACK = 3
"""Fewest rows per name, on average; a column with fewer is a measurement, not a name."""
SMOOTH = 0.25
"""Frames follow each other if a step is shorter than this part of the way in half a track. For
points at random positions the ratio is about 1."""
FEWEST = 4
"""Points of a track that can show whether frames follow each other."""


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
        left_out = (
            f" {count(self.left_out, 'frame', 'were')} left out for having one of the points twice."
        )
        more, bias = left_out * bool(self.left_out), float(self.errors.mean())
        return (
            f"The mean distance in {count(len(self.frames), 'frame')} is "
            f"{self.lengths_m.mean():.4f} m; the known length is {rounded(self.known_m, 4)} m. "
            f"The mean error is {100 * self.mean_error:.2f} %, the mean is "
            f"{100 * abs(bias):.2f} % too {'long' if bias > 0 else 'short'}.{more}"
        )


def further_columns(points: pd.DataFrame) -> list[str]:
    """The columns that were passed through."""
    known = {*POINT_COLUMNS, *SIGMA_COLUMNS, OUTSIDE_VOLUME, COORDINATES, "ambiguous", "views"}
    return [str(name) for name in points.columns if name not in known]


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


def track_columns(points: pd.DataFrame) -> list[str]:
    """What can name tracks: columns that name no point twice in a frame, or `ONE_A_FRAME`.

    Args:
        points: rows of `points.csv`.
    """
    if len(points) >= ROWS_PER_TRACK and not points["frame"].duplicated().any():
        return [ONE_A_FRAME]
    return [
        name
        for name in further_columns(points)
        if 1 <= points[name].nunique() <= len(points) / ROWS_PER_TRACK
        and not points[["frame", name]].dropna().duplicated().any()
    ]


def tracks_by(points: pd.DataFrame, column: str) -> list[IntArray]:
    """Rows of each track, in the order of the frames.

    A track ends where frames are missing: at a step longer than most.

    Args:
        points: rows of `points.csv`; those without a position take no part.
        column: one of `track_columns`.
    """
    known = np.isfinite(points["x"].to_numpy(dtype=np.float64))
    names = np.zeros(len(points), dtype=np.int64)
    if column != ONE_A_FRAME:
        names = pd.factorize(points[column])[0].astype(np.int64)
        known &= names >= 0
    rows = np.flatnonzero(known)
    frames = points["frame"].to_numpy(dtype=np.int64)
    rows = rows[np.lexsort([frames[rows], names[rows]])]
    if len(rows) < 2:
        return []
    same = np.diff(names[rows]) == 0
    steps = np.diff(frames[rows])
    usual = np.median(steps[same]) if same.any() else 1
    ends = np.flatnonzero(~same | (steps > usual)) + 1
    return [track for track in np.split(rows, ends) if len(track) > 1]


def frames_follow(points: pd.DataFrame, tracks: list[IntArray]) -> bool:
    """Whether the frames follow each other so closely that lines between them show the way."""
    xyz = points[["x", "y", "z"]].to_numpy(dtype=np.float64)
    long = [xyz[track] for track in tracks if len(track) >= FEWEST]
    if not long:
        return False
    near, far = (
        np.concatenate([np.linalg.norm(xyz[step:] - xyz[:-step], axis=1) for xyz, step in steps])
        for steps in ([(xyz, 1) for xyz in long], [(xyz, len(xyz) // 2) for xyz in long])
    )
    return bool(np.median(near) < SMOOTH * np.median(far))


def usual_tracks(points: pd.DataFrame) -> str | None:
    """The first of `track_columns` whose frames follow each other; None if there is none."""
    columns = track_columns(points)
    return next((each for each in columns if frames_follow(points, tracks_by(points, each))), None)
