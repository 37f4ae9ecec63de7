"""Trajectories: points of the same name, or the only point of each frame, in successive frames."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stereocal.matching.lengths import further_columns
from stereocal.rig.compiled import FloatArray, IntArray

ONE_A_FRAME = "the point of each frame"
ROWS_PER_TRACK = 3
"""Fewest rows per name, on average; a column with fewer is a measurement, not a name."""
SMOOTH = 0.25
"""Frames follow each other if a step is shorter than this part of the way in half a track. For
points at random positions the ratio is about 1."""
FEWEST = 4
"""Points of a track that can show whether frames follow each other."""


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
    long = [track for track in tracks if len(track) >= FEWEST]
    if not long:
        return False
    near = np.concatenate([_apart(xyz[track], 1) for track in long])
    far = np.concatenate([_apart(xyz[track], len(track) // 2) for track in long])
    return bool(np.median(near) < SMOOTH * np.median(far))


def usual_tracks(points: pd.DataFrame) -> str | None:
    """The first of `track_columns` whose frames follow each other; None if there is none."""
    for column in track_columns(points):
        if frames_follow(points, tracks_by(points, column)):
            return column
    return None


def _apart(xyz: FloatArray, rows: int) -> FloatArray:
    """Distances of points `rows` rows apart."""
    distances: FloatArray = np.linalg.norm(xyz[rows:] - xyz[:-rows], axis=1)
    return distances
