"""The points of a recording as the joint adjustment takes them: units of two, seen by N cameras."""

import math
from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.refined.distortion import lenses_of_cameras
from stereocal.refined.observations import Observations
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.recording import Recording

MOST_IMAGES = 50_000_000
"""Of all targets in all frames and cameras: 800 MB of pixels."""


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


def observations_of(recording: Recording, velocities: FloatArray | None = None) -> Observations:
    """The units of all frames, of the points that two cameras or more see.

    As in a pair, a unit is two targets with one of the longest known distances among those seen
    (`RigidObject.pairs_among`), or a single target.

    Args:
        velocities: (n, 2): of the points in pixels per frame, if cameras may be late.
    """
    frames, pixels = images_of(recording)
    shared = np.isfinite(pixels[..., 0]).sum(axis=2) > 1
    kept = np.flatnonzero(shared.any(axis=1))
    units_of: dict[bytes, list[tuple[int, int]]] = {}
    frame_of: list[int] = []
    targets: list[tuple[int, int]] = []
    for i, seen in enumerate(shared[kept]):
        if (units := units_of.get(seen.tobytes())) is None:
            known = np.flatnonzero(seen)
            pairs = recording.object.pairs_among(known.tolist())
            units = [(one, other) for one, other in pairs.tolist()]
            units += [(target, -1) for target in np.setdiff1d(known, pairs).tolist()]
            units_of[seen.tobytes()] = units
        frame_of += [i] * len(units)
        targets += units
    which, ends = np.array(frame_of, np.int64), np.array(targets, np.int64).reshape(-1, 2)
    single, of_units = ends[:, 1] < 0, (kept[which][:, None], ends)
    images, cameras = pixels[of_units], list(recording.cameras.values())
    images[single, 1] = np.nan
    rays, motion = np.full(images.shape, np.nan), np.empty((0, *images.shape[1:3], 3))
    for number, camera in enumerate(cameras):
        known = np.isfinite(images[:, :, number, 0])
        rays[:, :, number][known] = camera.undistort(images[:, :, number][known])
    if velocities is not None:
        _, moving = images_of(recording, np.pad(velocities, [(0, 0), (0, 1)]))
        motion = np.nan_to_num(moving[of_units])
    distances = np.where(single, np.nan, recording.object.distance(*ends.T))
    lenses, longest_m = lenses_of_cameras(*cameras), recording.object.longest_m
    variances = np.ones(len(kept))
    return Observations(
        frames[kept], which, ends, images, rays, motion, distances, lenses, longest_m, variances
    )
