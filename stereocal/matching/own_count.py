"""The points of a camera by its own count of frames, and where they are at another camera's frames.

They can be brought there where they have tracks: points of the same name, or the only point of each
frame, in successive frames.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from stereocal.matching.trajectories import naming_columns
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.tracks import MeasuredOffset, TimeOffset, interpolate

SHIFT = "time_shift_frames"
"""Column of points that were shifted: by how many frames, 0 where they have no neighbours."""
TIME = "time_frame"
SMOOTH = 0.5
"""Frames follow each other if a step is shorter than this part of the distance from the middle of
all points. Measured: 0.19 on a real recording at 10 frames a second; 1.4 at random positions."""
RATE = 5e-4
"""The least change of an offset from frame to frame that is one of rates."""


@dataclass(frozen=True, eq=False)
class Seen:
    """The n points of a camera."""

    frame: IntArray
    times: IntArray
    """Their frames as recorded."""
    pixels: FloatArray
    """(n, 2)."""
    track: IntArray | None
    """(n,); None if no column names tracks whose frames follow."""

    @classmethod
    def of(cls, points: pd.DataFrame, columns: tuple[str, str]) -> "Seen":
        """Those of a table with the column `frame`, perhaps `TIME`, and names of tracks."""
        frame = points["frame"].to_numpy(dtype=np.int64)
        pixels = points[list(columns)].to_numpy(dtype=np.float64)
        recorded = pd.to_numeric(points.get(TIME, points["frame"]), errors="coerce")
        times = np.where(np.isfinite(recorded), recorded, frame).astype(np.int64)
        return cls(frame, times, pixels, _tracks(points, times, pixels, columns))

    def where(self, used: BoolArray) -> "Seen":
        """Some of the points."""
        track = None if self.track is None else self.track[used]
        return Seen(self.frame[used], self.times[used], self.pixels[used], track)

    def numbered(self, offset: MeasuredOffset) -> tuple[IntArray, IntArray, BoolArray]:
        """The primary's frame for each point; the same by the count as recorded; and whether it is
        the nearest to that frame of a camera with another rate, (n,) each."""
        if abs(offset.drift) < RATE:
            whole, _ = offset.split()
            return self.frame + whole, self.times + whole, np.ones(len(self.frame), np.bool_)
        moment = np.floor(self.times + offset.at(self.times) + 0.5).astype(np.int64)
        late = self.late(offset, moment)
        return moment, moment, (late >= -0.5) & (late < 0.5)

    def late(self, offset: TimeOffset, moment: IntArray) -> FloatArray:
        """(n,): by how many of its own frames a point is later than a frame of the primary."""
        return (self.times - moment + offset.at(self.times)) / (1.0 + offset.drift)

    def at(
        self, offset: TimeOffset, moment: IntArray, size: tuple[int, int]
    ) -> tuple[FloatArray, BoolArray]:
        """The points at frames of the primary, (n, 2), and whether that is known, (n,); those that
        have no neighbours or would leave the image are where they are."""
        late = self.late(offset, moment)
        if self.track is None:
            return self.pixels, np.zeros(len(late), np.bool_)
        found = interpolate(self.track, self.times, self.pixels, late)
        known = found.inside(size)
        return np.where(known[:, None], found.positions, self.pixels), known


def _tracks(
    points: pd.DataFrame, times: IntArray, pixels: FloatArray, columns: tuple[str, str]
) -> IntArray | None:
    """(n,): the track of each point; None if no column names tracks whose frames follow."""
    if not pd.Series(times).duplicated().any():
        one = np.zeros(len(points), dtype=np.int64)
        return one if _follow(one, times, pixels) else None
    further = points.columns.difference(["frame", TIME, *columns], sort=False)
    for name in naming_columns(points.assign(frame=times), further):
        codes = pd.factorize(points[name])[0].astype(np.int64)
        if (codes >= 0).all() and _follow(codes, times, pixels):
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
