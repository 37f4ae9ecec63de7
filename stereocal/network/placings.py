"""The points of a recording as the joint adjustment takes them: units of two, seen by N cameras."""

import math
from dataclasses import dataclass, replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.recording import Recording

MOST_IMAGES = 50_000_000
"""Of all targets in all frames and cameras: 800 MB of pixels."""


@dataclass(frozen=True, eq=False)
class Placings:
    """The placings of an object, in units as of `views`; a frame has one placing."""

    frames: IntArray
    """(f,): the frame numbers, ascending."""
    of_frame: IntArray
    """(n,): index of the frame of each unit."""
    targets: IntArray
    """(n, 2): indices into the object's names; -1 for none."""
    pixels: FloatArray
    """(n, 2, c, 2): raw; NaN where a camera does not see a point."""
    distances: FloatArray
    """(n,): in metres; NaN for a unit of one point."""

    @property
    def seen(self) -> BoolArray:
        """(n, 2, c)."""
        return np.asarray(np.isfinite(self.pixels[..., 0]))


def rows_where(recording: Recording, kept: BoolArray) -> Recording:
    """A recording without some of its rows."""
    columns = ("frame", "camera", "target", "points", "sigma_px")
    return replace(recording, **{name: getattr(recording, name)[kept] for name in columns})


def images_of(
    recording: Recording, values: FloatArray | None = None
) -> tuple[IntArray, FloatArray]:
    """The frame numbers (f,), and the pixels of all targets (f, k, c, 2); NaN where not seen.

    Args:
        values: (n, v): others of the recording's rows, instead of their pixels.
    """
    of_rows = recording.points if values is None else values
    frames, at = np.unique(recording.frame, return_inverse=True)
    shape = len(frames), len(recording.object.names), len(recording.cameras)
    if math.prod(shape) > MOST_IMAGES:
        raise StereocalError(
            f"{shape[0]} frames of an object with {shape[1]} points before {shape[2]} cameras are "
            "too many: name only the points that are seen, or take fewer frames."
        )
    found = np.full((*shape, of_rows.shape[1]), np.nan)
    found[at, recording.target, recording.camera] = of_rows
    return frames, found


def placings_of(recording: Recording) -> Placings:
    """The units of all frames, of the points that two cameras or more see.

    As in a pair, a unit is two targets with one of the longest known distances among those seen
    (`RigidObject.pairs_among`), or a single target.
    """
    frames, pixels = images_of(recording)
    several = np.isfinite(pixels[..., 0]).sum(axis=2) > 1
    kept = np.flatnonzero(several.any(axis=1))
    frames, pixels, several = frames[kept], pixels[kept], several[kept]
    units_of: dict[bytes, list[tuple[int, int]]] = {}
    of_frame: list[int] = []
    targets: list[tuple[int, int]] = []
    for i, seen in enumerate(several):
        if (own := units_of.get(seen.tobytes())) is None:
            known = np.flatnonzero(seen)
            pairs = recording.object.pairs_among(known.tolist())
            own = [(one, other) for one, other in pairs.tolist()]
            own += [(target, -1) for target in np.setdiff1d(known, pairs).tolist()]
            units_of[seen.tobytes()] = own
        of_frame += [i] * len(own)
        targets += own
    which, ends = np.array(of_frame, np.int64), np.array(targets, np.int64).reshape(-1, 2)
    images = pixels[which[:, None], ends]
    images[ends[:, 1] < 0, 1] = np.nan
    distances = recording.object.distance(*ends.T)
    return Placings(frames, which, ends, images, np.where(ends[:, 1] < 0, np.nan, distances))
