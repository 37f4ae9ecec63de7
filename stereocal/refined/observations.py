"""What N cameras saw of an object, in the units that are fitted: a pair is the case of two."""

from dataclasses import dataclass

import numpy as np

from stereocal.refined.distortion import lenses_of_cameras
from stereocal.rig.correspondences import TARGETS
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import TimeOffset
from stereocal.system.array_types import BoolArray, FloatArray, IntArray

MOTION, VARIANCE, DISTANCE = slice(4, 7), 7, 8
"""Columns of `_columns`, after pixels and rays."""


@dataclass(frozen=True, eq=False)
class Observations:
    """Units of two points (`views`): a bar is one, the placing of an object several."""

    frames: IntArray
    """(f,): the frame numbers, ascending."""
    frame_of: IntArray
    """(n,): index of the frame of each unit."""
    targets: IntArray
    """(n, 2): indices into the object's names; -1 for none."""
    pixels: FloatArray
    """(n, 2, c, 2), and the next ones, as in `views.Units`."""
    rays: FloatArray
    motion: FloatArray
    distances: FloatArray
    lenses: FloatArray
    """(c, 23): as in `views.Cameras`."""
    length_m: float
    """Of the bar, or the longest of the object."""
    variances: FloatArray
    """(f, ...): of the pixels, over those of recorded ones."""

    @classmethod
    def of(
        cls, recording: Recording, moving: bool = False, rows: BoolArray | None = None
    ) -> "Observations":
        """Those of the points that two cameras or more see.

        Args:
            moving: whether cameras may be late, so that the motion is needed (`Recording.shifted`).
            rows: mask (n,) of the points; all if None.
        """
        known = recording if rows is None else recording.where(rows)
        frames, images = known.images(_columns(known))
        of_rows = np.nonzero(np.isfinite(images[..., 0]).sum(axis=2) > 1)
        part, place = known.object.parts_of(*of_rows)
        _, first = np.unique(part, return_index=True)
        kept, frame_of = np.unique(of_rows[0][first], return_inverse=True)
        units = np.full((len(first), 2, *images.shape[2:]), np.nan)
        units[part, place] = images[of_rows]
        targets = np.full((len(first), 2), -1)
        targets[part, place] = of_rows[1]
        variances = np.ones((len(frames), images.shape[1]))
        variances[of_rows] = np.nanmean(images[of_rows][..., VARIANCE], axis=1)
        stated = known.object.distance(*targets.T)
        if known.distance_m is not None and known.object.names == TARGETS:
            own = np.fmax.reduce(units[..., DISTANCE], axis=(1, 2))
            stated = np.where(np.isfinite(own), own, stated)
        return cls(
            frames[kept],
            frame_of,
            targets,
            np.ascontiguousarray(units[..., :2]),
            np.ascontiguousarray(units[..., 2:4]),
            np.nan_to_num(units[..., MOTION])[: len(first) if moving else 0],
            np.where(targets[:, 1] < 0, np.nan, stated),
            lenses_of_cameras(*known.cameras.values()),
            known.object.longest_m,
            variances[kept],
        )

    @property
    def has_lengths(self) -> bool:
        """Whether the length of any unit is known."""
        return bool(np.isfinite(self.distances).any())

    @property
    def has_parts(self) -> bool:
        """Whether frames have several units, whose errors may be alike."""
        return len(self.frame_of) > len(self.frames)


def _columns(recording: Recording) -> FloatArray:
    """(n, 9): of each point its pixel, its ray, its velocity in pixels per frame and the frame from
    which a drift counts, the variance of its position, and the stated length of its bar."""
    n = len(recording.frame)
    motion = np.full((n, 3), np.nan) if recording.motion is None else recording.motion
    late = np.array([name in recording.offsets for name in recording.cameras])[recording.camera]
    reference = next(iter(recording.offsets.values()), TimeOffset()).reference
    lengths = np.full(n, np.nan) if recording.distance_m is None else recording.distance_m
    return np.column_stack(
        [
            recording.points,
            recording.rays,
            motion[:, :2],
            np.where(late, recording.times - reference, 0.0),
            np.nan_to_num(motion[:, 2], nan=1.0),
            lengths,
        ]
    )
