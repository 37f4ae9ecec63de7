"""Where the secondary camera stands before anything is calibrated, for what is said of the data."""

import numpy as np

from stereocal.fit.start.first_poses import robust_start
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.system.latest import once

PAIRS = 500
"""Pairs of points from which it is estimated."""


def rough_pose(dataset: Pair) -> Pose | None:
    """The pose of the secondary camera from some of the pairs, robust to wrong ones; estimated once
    for a data set, by its digest. None with fewer than 6 pairs, or without a solution."""
    step = len(dataset.correspondences) // PAIRS + 1
    rays = dataset.rays[:, ::step]
    return once(
        "rough pose", dataset.sha256, lambda: robust_start(dataset, np.ascontiguousarray(rays))
    )
