"""What N cameras saw of an object, in the units that are fitted: a pair is the case of two."""

from dataclasses import dataclass

import numpy as np

from stereocal.fit.least_squares.distortion import lenses_of_cameras
from stereocal.fit.least_squares.stated_windows import windows_held
from stereocal.rig.correspondences import TARGETS
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import TimeOffset
from stereocal.system.array_types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Observations:
    """Units of two points (`views`): a bar is one, the placing of an object several."""

    recording: Recording
    """Of the points."""
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
    windows: FloatArray
    """The same."""
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
        frames, images = known.images(np.hstack([known.points, known.rays]))
        of_rows = np.nonzero(np.isfinite(images[..., 0]).sum(axis=2) > 1)
        part, place = known.object.parts_of(*of_rows)
        _, first = np.unique(part, return_index=True)
        kept, frame_of = np.unique(of_rows[0][first], return_inverse=True)
        n = len(first)

        def by_unit(images: FloatArray) -> FloatArray:
            values = np.full((n, 2, *images.shape[2:]), np.nan)
            values[part, place] = images[of_rows]
            return values

        targets = np.full((n, 2), -1)
        targets[part, place] = of_rows[1]
        motion, variances = np.empty((0, 2, images.shape[2], 3)), np.ones(images.shape[:2])
        if moving:
            motion = np.nan_to_num(by_unit(known.images(_motion(known))[1]))
        if known.motion is not None:
            of_images = known.images(np.nan_to_num(known.motion[:, 2:], nan=1.0))[1]
            variances[of_rows] = np.nanmean(of_images[of_rows], axis=(1, 2))
        distances = known.object.distance(*targets.T)
        if known.distance_m is not None and known.object.names == TARGETS:
            measured_m = by_unit(known.images(known.distance_m[:, None])[1])
            stated = np.fmax.reduce(measured_m, axis=(1, 2, 3))
            distances = np.where(np.isfinite(stated), stated, distances)
        return cls(
            known,
            frames[kept],
            frame_of,
            targets,
            by_unit(images[..., :2]),
            by_unit(images[..., 2:]),
            motion,
            np.where(targets[:, 1] < 0, np.nan, distances),
            lenses_of_cameras(*known.cameras.values()),
            windows_held(known),
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


def _motion(recording: Recording) -> FloatArray:
    """(n, 3): of each point its velocity in pixels per frame, 0 where it is not known, and the
    frame from which a drift counts."""
    late = np.array([name in recording.offsets for name in recording.cameras])[recording.camera]
    reference = next(iter(recording.offsets.values()), TimeOffset()).reference
    motion = np.zeros((len(recording.frame), 3))
    if recording.motion is not None:
        motion[:, :2] = np.nan_to_num(recording.motion[:, :2])
    motion[late, 2] = recording.times[late] - reference
    return motion
