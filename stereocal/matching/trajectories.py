"""What a table of 3D points (`points.csv`) holds, and its trajectories: points of the same name, or
the only point of each frame, in successive frames."""

from collections.abc import Iterable

import numpy as np
import pandas as pd

from stereocal.matching.names import TRACKS, texts
from stereocal.rig.camera import CAMERAS
from stereocal.system.array_types import IntArray

POINT_COLUMNS = ("frame", "x", "y", "z", "error_px")
SIGMA_COLUMNS = ("sigma_x", "sigma_y", "sigma_z")
OUTSIDE_VOLUME = "outside_volume"
COORDINATES = "coordinates"
"""Names the world frame of x, y, z; without this column they are in the primary's frame."""
TRACK = "track"
"""Names the trajectory of a point."""
ONE_A_FRAME = "the point of each frame"
ROWS_PER_TRACK = 3
"""Fewest rows per name, on average; a column with fewer is a measurement, not a name."""
SMOOTH = 0.25
"""Frames follow each other if a step is shorter than this part of the way in half a track. For
points at random positions the ratio is about 1."""
FEWEST = 4
"""Points of a track that can show whether frames follow each other."""


def further_columns(points: pd.DataFrame) -> list[str]:
    """The columns that were passed through."""
    known = {*POINT_COLUMNS, *SIGMA_COLUMNS, OUTSIDE_VOLUME, COORDINATES, "ambiguous", "views"}
    return [str(name) for name in points.columns if name not in known]


def track_columns(points: pd.DataFrame) -> list[str]:
    """What can name tracks: columns that name no point twice in a frame, or `ONE_A_FRAME`.

    Args:
        points: rows of `points.csv`.
    """
    if len(points) >= ROWS_PER_TRACK and not points["frame"].duplicated().any():
        return [ONE_A_FRAME]
    return naming_columns(points, sorted(further_columns(points), key=lambda name: name != TRACK))


def naming_columns(points: pd.DataFrame, columns: Iterable[str]) -> list[str]:
    """Those of the columns that can name tracks: of few values, none of them twice in a frame."""
    return [
        name
        for name in columns
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
    """The column `TRACK`, else the first of `track_columns` whose frames follow each other; None if
    there is none."""
    columns = track_columns(points)
    if TRACK in columns:
        return TRACK
    return next(
        (column for column in columns if frames_follow(points, tracks_by(points, column))), None
    )


def with_track(points: pd.DataFrame) -> pd.DataFrame:
    """The points with the column `TRACK`, the trajectories that a page draws of them: the name of
    each, or its number from 1; unchanged if it is there already, or if no trajectory is known.

    Args:
        points: all rows of `points.csv`.
    """
    if TRACK in points:
        return points
    column = usual_tracks(points)
    if column == ONE_A_FRAME:
        numbers = pd.array([pd.NA] * len(points), dtype="Int64")
        for number, rows in enumerate(tracks_by(points, column), 1):
            numbers[rows] = number
        return points.assign(**{TRACK: numbers})
    tracks = [""] * len(points) if column is None else texts(points, [column])
    if column is None:  # tracks of one name in both cameras, however short
        sides = ([f"{name}_{which}" for which in CAMERAS] for name in TRACKS)
        for one, two in (both for both in sides if {*both} <= {*points}):
            names = zip(texts(points, [one]), texts(points, [two]), strict=True)
            tracks = [first if first == second else "" for first, second in names]
            break
    return points.assign(**{TRACK: tracks}) if any(tracks) else points
