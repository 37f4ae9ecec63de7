"""The least and second least reprojection error of each point, for choosing a threshold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.matching.matching import ANY_DEPTH, check_depths
from stereocal.matching.pair_candidates import pairs_within
from stereocal.matching.threshold import FramePixels
from stereocal.rig.compiled import FloatArray
from stereocal.rig.parameters import RigParameters


@dataclass(frozen=True, eq=False)
class NearestErrors:
    """Errors of n points of the primary camera."""

    best_px: FloatArray
    """(n,) least reprojection error with any point of the secondary; inf if there is none."""
    runner_up_px: FloatArray
    """(n,) second least; inf if there is none."""
    frames: int
    """Number of frames."""

    def __len__(self) -> int:
        return len(self.best_px)

    def within(self, threshold_px: float) -> tuple[int, int]:
        """The numbers of points with one and with two partners within the threshold."""
        return (
            int((self.best_px <= threshold_px).sum()),
            int((self.runner_up_px <= threshold_px).sum()),
        )


def nearest_errors(
    rig: RigParameters, frames: Sequence[FramePixels], depths_m: tuple[float, float] = ANY_DEPTH
) -> NearestErrors:
    """The two least errors of each primary point."""
    near, far = check_depths(depths_m)
    found = [np.empty((0, 2))]
    for primary, secondary in frames:
        if not len(primary):
            continue
        first = rig.primary.undistort(primary[:, :2])
        second = rig.secondary.undistort(secondary[:, :2])
        _, _, _, least, _ = pairs_within(
            rig.pose.R, rig.pose.T, first, second, rig.pixel_scale, 0.0, near, far
        )
        found.append(least)
    both = np.concatenate(found)
    return NearestErrors(both[:, 0], both[:, 1], len(frames))
