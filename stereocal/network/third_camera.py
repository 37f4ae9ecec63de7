"""Points of two cameras seen by a third: how far off pairs by themselves are, and the rig."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np

from stereocal.network.result import RigCalibration
from stereocal.refined.unknowns import camera_of
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig

FEWEST_POINTS = 10
MOST_TRIPLES = 120


def third_cameras(rig: RigCalibration, images: FloatArray | None = None) -> list[dict[str, Any]]:
    """Median distances (px) of points of two cameras from their images in a third, as in
    `rig.json`: before, with the three pairs by themselves, and after.

    Args:
        images: (n, c, 2): of points; None for those that the rig was fitted to.
    """
    found: list[dict[str, Any]] = []
    if images is None:
        used = rig.fit.pixels[~rig.fit.outlying[rig.fit.frame_of]]
        images = used.reshape(-1, len(rig.names), 2)
    for trio in combinations(range(len(rig.names)), 3):
        seen = images[:, trio]
        seen = seen[np.isfinite(seen[..., 0]).all(axis=1)]
        if len(seen) < FEWEST_POINTS or len(found) >= MOST_TRIPLES:
            continue
        for order in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            a, b, c = (rig.names[trio[k]] for k in order)
            pose, to_third = rig.pair_pose(a, b), rig.pair_pose(a, c)
            if pose is None or to_third is None:
                continue
            alone = Rig(_lens(rig, a, b, a), _lens(rig, a, b, b), pose)
            before = _off(alone, _lens(rig, a, c, c), to_third, seen[:, order])
            pair = Rig(rig.cameras[a], rig.cameras[b], rig.pose_of((a, b)))
            after = _off(pair, rig.cameras[c], rig.pose_of((a, c)), seen[:, order])
            own = {"pair": [a, b], "camera": c, "points": len(seen)}
            found.append({**own, "before": before, "after": after})
    return found


def _off(pair: Rig, third: Camera, to_third: Pose, images: FloatArray) -> float:
    """Median distance of the points of a pair from their images (n, 3, 2) in the third camera."""
    points = pair.reconstruct(images[:, 0], images[:, 1])
    found = third.project(to_third.apply(points))
    return float(np.nanmedian(np.linalg.norm(found - images[:, 2], axis=1)))


def _lens(rig: RigCalibration, one: str, other: str, which: str) -> Camera:
    """A camera's lens as a pair has it."""
    pair = (one, other) if (one, other) in rig.pairs.fits else (other, one)
    stated = rig.recording.cameras[which]
    return camera_of(stated, rig.pairs.fits[pair].q, pair.index(which))
