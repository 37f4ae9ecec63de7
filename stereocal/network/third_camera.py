"""Points of two cameras seen by a third: how far off pairs by themselves are, and the rig."""

from __future__ import annotations

from itertools import combinations

import numpy as np

from stereocal.network.result import RigCalibration, ThirdCamera
from stereocal.refined.unknowns import camera_of
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.rig import Rig

FEWEST_POINTS = 10
MOST_TRIPLES = 120


def third_cameras(rig: RigCalibration) -> list[ThirdCamera]:
    """Of every two calibrated pairs of three cameras that see enough points together.

    The points are those that the rig was fitted to.
    """
    own = rig.used_placings
    found: list[ThirdCamera] = []
    images = own.pixels.reshape(-1, len(rig.names), 2)
    for a, b, c in combinations(range(len(rig.names)), 3):
        seen = np.isfinite(images[:, [a, b, c], 0]).all(axis=1)
        if seen.sum() < FEWEST_POINTS or len(found) >= MOST_TRIPLES:
            continue
        for one, other, third in ((a, b, c), (a, c, b), (b, c, a)):
            before = _before(rig, one, other, third, images[seen])
            after = _after(rig, one, other, third, images[seen])
            if before is not None:
                names = rig.names[one], rig.names[other], rig.names[third]
                found.append(ThirdCamera(names, before, after, int(seen.sum())))
    return found


def _after(rig: RigCalibration, one: int, other: int, third: int, images: FloatArray) -> float:
    names = rig.names[one], rig.names[other], rig.names[third]
    pair = Rig(rig.cameras[names[0]], rig.cameras[names[1]], rig.pose_of(names[:2]))
    points = pair.reconstruct(images[:, one], images[:, other])
    seen = rig.cameras[names[2]].project(rig.pose_of((names[0], names[2])).apply(points))
    return _distance(seen, images[:, third])


def _before(
    rig: RigCalibration, one: int, other: int, third: int, images: FloatArray
) -> float | None:
    """With the lenses and poses of two pairs; None if one was not calibrated."""
    a, b, c = rig.names[one], rig.names[other], rig.names[third]
    pose, to_third = rig.pair_pose(a, b), rig.pair_pose(a, c)
    if pose is None or to_third is None:
        return None
    pair = Rig(_lens(rig, a, b, a), _lens(rig, a, b, b), pose)
    points = pair.reconstruct(images[:, one], images[:, other])
    seen = _lens(rig, a, c, c).project(to_third.apply(points))
    return _distance(seen, images[:, third])


def _lens(rig: RigCalibration, one: str, other: str, which: str) -> Camera:
    """A camera's lens as a pair has it."""
    pair = (one, other) if (one, other) in rig.pairs.fits else (other, one)
    stated = rig.recording.cameras[which]
    return camera_of(stated, rig.pairs.fits[pair].q, pair.index(which))


def _distance(found: FloatArray, images: FloatArray) -> float:
    return float(np.nanmedian(np.linalg.norm(found - images, axis=1)))
