"""Bring the points of the secondary camera into step with those of the primary.

A parameter file that was fitted to shifted points says by how much the secondary camera is late.
The points that it matches or measures must be shifted too, which their tracks allow: points of the
same name, or the only point of each frame, in successive frames.
"""

import numpy as np
import pandas as pd

from stereocal.matching.counts import offset_of_pairs
from stereocal.matching.point_table import PointTable
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray, IntArray
from stereocal.rig.correspondences import PIXELS
from stereocal.rig.parameters import RigParameters
from stereocal.rig.tracks import MeasuredOffset, TimeOffset, interpolate

SHIFT = "time_shift_frames"
"""Column of points that were shifted: by how many frames, 0 where they have no neighbours."""
TIME = "time_frame"
ROWS_PER_TRACK = 3
"""Fewest rows per name, on average; a column with fewer is a measurement, not a name."""
SMOOTH = 0.5
"""Frames follow each other if a step is shorter than this part of the distance from the middle of
all points. Measured: 0.19 on a real recording at 10 frames a second; 1.4 at random positions."""


def table_in_step(
    table: PointTable, columns: tuple[str, str], rig: RigParameters
) -> tuple[PointTable, str]:
    """As `points_in_step`, of a table that is read whole only if it has to be shifted."""
    if (rig.time_offset is None and not rig.start_frame) or SHIFT in table.further:
        return table, ""
    whole, note = points_in_step(pd.concat(list(table.blocks())), columns, rig)
    return PointTable(whole, table.numbers, table.label), note and f"{table.label}: {note}"


def points_in_step(
    points: pd.DataFrame, columns: tuple[str, str], rig: RigParameters
) -> tuple[pd.DataFrame, str]:
    """Points with those of the secondary shifted by the time offset of a parameter file, and what
    was done as a sentence; unchanged, and empty, if there is none or they are shifted already.

    Args:
        columns: of the secondary points.
    """
    offset = rig.time_offset
    if rig.start_frame and columns == PIXELS[2:] and SHIFT not in points:

        def points_at(tried: MeasuredOffset) -> tuple[FloatArray, FloatArray]:
            moved = shift(points, columns, tried, rig.secondary)[0]
            return points[list(PIXELS[:2])].to_numpy(), moved[list(columns)].to_numpy()

        offset = offset_of_pairs(rig, rig.start_frame, points_at)
    if offset is None or SHIFT in points:
        return points, ""
    shifted, note = shift(points, columns, offset, rig.secondary)
    return points.assign(**{str(name): shifted[name] for name in shifted}), note


def shift(
    points: pd.DataFrame, columns: tuple[str, str], offset: TimeOffset, camera: Camera
) -> tuple[pd.DataFrame, str]:
    """The coordinates of points shifted in time, with the column `SHIFT`, and a sentence.

    Points without neighbours, and those that would leave the image, stay where they are.

    Args:
        points: with the column `frame`, perhaps `TIME`, and columns that name tracks.
        columns: of the coordinates.
    """
    pixels = points[list(columns)].to_numpy(dtype=np.float64)
    times = points["frame"].to_numpy(dtype=np.int64)
    if TIME in points:  # the frames as recorded
        recorded = pd.to_numeric(points[TIME], errors="coerce").to_numpy(dtype=np.float64)
        times = np.where(np.isfinite(recorded), recorded, times).astype(np.int64)
    offsets = offset.at(times)
    kept = points[list(columns)].astype(np.float64).assign(**{SHIFT: 0.0})
    track = _tracks(points, times, pixels, columns)
    if track is None:
        return kept, (
            f"the time offset of {offset.frames:.3f} frames could not be applied, because no "
            "column names the tracks of points from frame to frame: the secondary points are used "
            "as recorded."
        )
    found = interpolate(track, times, pixels, offsets)
    known = found.inside(camera.image_size)
    kept[list(columns)] = np.where(known[:, None], found.positions, pixels)
    kept[SHIFT] = np.where(known, offsets, 0.0)
    lost = int((~known).sum())
    return kept, (
        f"the secondary points were shifted in time by {offset.frames:.3f} frames"
        + (f"; {lost} of {len(points)} have no neighbours in their track and were not" * (lost > 0))
        + "."
    )


def _tracks(
    points: pd.DataFrame, times: IntArray, pixels: FloatArray, columns: tuple[str, str]
) -> IntArray | None:
    """(n,): the track of each point; None if no column names tracks whose frames follow."""
    if not pd.Series(times).duplicated().any():
        one = np.zeros(len(points), dtype=np.int64)
        return one if _follow(one, times, pixels) else None
    for name in points.columns.difference(["frame", TIME, *columns], sort=False):
        codes = pd.factorize(points[name])[0].astype(np.int64)
        twice = pd.DataFrame({"time": times, "name": codes}).duplicated().any()
        few = 0 < codes.max() + 1 <= len(points) / ROWS_PER_TRACK
        if few and not twice and (codes >= 0).all() and _follow(codes, times, pixels):
            return codes
    return None


def _follow(track: IntArray, times: IntArray, pixels: FloatArray) -> bool:
    """Whether the frames of tracks follow each other so closely that points can be interpolated."""
    order = np.lexsort([times, track])
    same = (np.diff(track[order]) == 0) & (np.diff(times[order]) == 1)
    if not same.any():
        return False
    steps = np.linalg.norm(np.diff(pixels[order], axis=0), axis=1)[same]
    far = np.linalg.norm(pixels - np.median(pixels, axis=0), axis=1)
    return bool(np.median(steps) < SMOOTH * np.median(far))
