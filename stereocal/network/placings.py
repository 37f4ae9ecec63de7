"""The points of a recording as the joint adjustment takes them: units of two, seen by N cameras."""

import numpy as np

from stereocal.refined.distortion import lenses_of_cameras
from stereocal.refined.observations import Observations
from stereocal.rig.compiled import FloatArray
from stereocal.rig.recording import Recording


def observations_of(recording: Recording, velocities: FloatArray | None = None) -> Observations:
    """The units of all frames, of the points that two cameras or more see.

    As in a pair, a unit is two targets with one of the longest known distances among those seen
    (`RigidObject.pairs_among`), or a single target.

    Args:
        velocities: (n, 2): of the points in pixels per frame, if cameras may be late.
    """
    frames, pixels = recording.images()
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
        _, moving = recording.images(np.pad(velocities, [(0, 0), (0, 1)]))
        motion = np.nan_to_num(moving[of_units])
    distances = np.where(single, np.nan, recording.object.distance(*ends.T))
    lenses, longest_m = lenses_of_cameras(*cameras), recording.object.longest_m
    variances = np.ones(len(kept))
    return Observations(
        frames[kept], which, ends, images, rays, motion, distances, lenses, longest_m, variances
    )
