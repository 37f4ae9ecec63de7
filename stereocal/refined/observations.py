"""What N cameras saw of an object, in the units that are fitted: a pair is the case of two."""

from dataclasses import dataclass

import numpy as np

from stereocal.refined.distortion import lenses_of_cameras
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.tracks import TimeOffset
from stereocal.system.array_types import BoolArray, FloatArray, IntArray


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
    def of_pair(cls, dataset: Pair, moving: bool, rows: BoolArray | None = None) -> "Observations":
        """Those of a data set; the units are `Correspondences.parts`.

        Args:
            moving: whether the secondary camera may be late, so that the motion is needed.
            rows: mask (n,) of the rows; all if None.
        """
        table = dataset.correspondences
        kept = np.ones(len(table), dtype=np.bool_) if rows is None else rows
        part, place = (column[kept] for column in table.parts)
        _, first, unit = np.unique(part, return_index=True, return_inverse=True)
        frames, frame_of = np.unique(table.frame[kept][first], return_inverse=True)
        n = len(first)
        targets = np.full((n, 2), -1)
        targets[unit, place] = table.target[kept]
        pixels, rays = np.full((n, 2, 2, 2), np.nan), np.full((n, 2, 2, 2), np.nan)
        pixels[unit, place, 0] = table.primary[kept]
        pixels[unit, place, 1] = table.secondary[kept]
        rays[unit, place] = dataset.rays[:, kept].T.reshape(-1, 2, 2)
        motion = np.zeros((n if moving else 0, 2, 2, 3))
        if moving:
            offset = dataset.time_offset or TimeOffset()
            motion[unit, place, 1, :2] = np.nan_to_num(table.motion[kept, :2])
            motion[unit, place, 1, 2] = table.time_frame[kept] - offset.reference
        variances = np.ones((len(frames), len(table.names)))
        of_rows = frame_of[unit], table.target[kept]
        variances[of_rows] = 0.5 + 0.5 * np.nan_to_num(table.motion[kept, 2], nan=1.0)
        bars, distances = kept[table.bars].all(axis=1), np.full(n, np.nan)
        of_bars = unit[np.searchsorted(np.flatnonzero(kept), table.bars[bars, 0])]
        distances[of_bars] = dataset.bar_distances_m[bars]
        return cls(
            frames,
            frame_of,
            targets,
            pixels,
            rays,
            motion,
            distances,
            lenses_of_cameras(dataset.primary, dataset.secondary),
            dataset.target_distance_m,
            variances,
        )

    @classmethod
    def of_recording(cls, recording: Recording, moving: FloatArray | None = None) -> "Observations":
        """Those of the points that two cameras or more see, with units as in a pair.

        Args:
            moving: (n, 3): of the points, velocities in pixels per frame and the frame from which
                the drift counts, if cameras may be late.
        """
        frames, images = recording.images()
        of_rows = np.nonzero(np.isfinite(images[..., 0]).sum(axis=2) > 1)
        part, place = recording.object.parts_of(*of_rows)
        _, first = np.unique(part, return_index=True)
        kept, frame_of = np.unique(of_rows[0][first], return_inverse=True)
        targets = np.full((len(first), 2), -1)
        targets[part, place] = of_rows[1]
        pixels = np.full((len(first), 2, *images.shape[2:]), np.nan)
        pixels[part, place] = images[of_rows]
        cameras, rays = list(recording.cameras.values()), np.full(pixels.shape, np.nan)
        for number, camera in enumerate(cameras):
            seen = np.isfinite(pixels[:, :, number, 0])
            rays[:, :, number][seen] = camera.undistort(pixels[:, :, number][seen])
        motion = np.zeros((0 if moving is None else len(first), *pixels.shape[1:3], 3))
        if moving is not None:
            motion[part, place] = np.nan_to_num(recording.images(moving)[1][of_rows])
        distances = recording.object.distance(*targets.T)
        return cls(
            frames[kept],
            frame_of,
            targets,
            pixels,
            rays,
            motion,
            np.where(targets[:, 1] < 0, np.nan, distances),
            lenses_of_cameras(*cameras),
            recording.object.longest_m,
            np.ones(len(kept)),
        )

    @property
    def has_lengths(self) -> bool:
        """Whether the length of any unit is known."""
        return bool(np.isfinite(self.distances).any())

    @property
    def has_parts(self) -> bool:
        """Whether frames have several units, whose errors may be alike."""
        return len(self.frame_of) > len(self.frames)
