"""How well images and bar lengths fit a pose, in two quantities that do not depend on the scale."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocal.calibration.essential import calibrate_essential
from stereocal.errors import StereocalError
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays

MAXIMUM_BEHIND = 0.2
"""Fraction of the points behind a camera above which a pose counts as no fit."""

LENGTH_TOLERANCE = 0.05
"""Relative difference up to which lengths count as equal."""


@dataclass(frozen=True)
class Fit:
    """How well a data set fits the pose of an essential matrix."""

    px: float
    """Median reprojection error."""
    spread: float
    """Median absolute deviation of the bar lengths, relative."""
    scale: float
    """Median of stated over reconstructed bar length; 1 if baseline and bar agree."""

    @property
    def only_scale_is_wrong(self) -> bool:
        """Whether all bar lengths are wrong by the same factor."""
        return bool(self.spread < LENGTH_TOLERANCE < abs(np.log(self.scale)))

    def gains_of(self, other: Fit) -> tuple[float, float]:
        """By what factors another fit is better, in the images and in the lengths."""
        if not np.isfinite(other.px):
            return 0.0, 0.0
        return self.px / max(other.px, 1e-9), self.spread / max(other.spread, 1e-9)


NO_FIT = Fit(np.inf, np.inf, np.nan)


def essential_fit(dataset: Dataset) -> Fit:
    """The fit of the constrained essential matrix; `NO_FIT` if there is no solution."""
    try:
        return pose_fit(dataset, calibrate_essential(dataset.rays, dataset.baseline_m).pose)
    except StereocalError:
        return NO_FIT


def pose_fit(dataset: Dataset, pose: Pose) -> Fit:
    """The fit of a pose; `NO_FIT` if too many points are behind a camera."""
    px = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale).mean(axis=1)
    logs = np.log(dataset.bar_distances_m / dataset.reconstructed_lengths_m(pose))
    known = logs[np.isfinite(logs)]
    if np.isnan(px).mean() > MAXIMUM_BEHIND or not len(known):
        return NO_FIT
    median = float(np.median(known))
    spread = float(np.median(np.abs(known - median)))
    return Fit(float(np.nanmedian(px)), spread, float(np.exp(median)))
