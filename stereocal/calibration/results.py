"""The result of one method, and its errors on a data set."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.calibration.montecarlo import Trace
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays

POOR_LENGTH = 0.05
"""Relative length error; a set whose 95th percentile is above it is not fit to measure with."""


@dataclass(frozen=True, eq=False)
class MethodResult:
    """The pose computed by one method, and details of the computation."""

    method: Method
    pose: Pose
    cost: float
    """Unit: `COST_UNITS[method]`."""
    evaluations: int
    stop_reason: str
    seconds: float
    trace: Trace | None = None


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of a pose on all pairs and bars of a data set; means exclude the frames left out."""

    reprojection_px: FloatArray
    """(n,): of each pair the mean over both cameras; NaN behind a camera."""
    length: FloatArray
    """(m,): of each bar |D - D^R| / D; NaN behind a camera."""
    kept_pairs: BoolArray
    """(n,): false for pairs of frames that were left out."""
    kept_bars: BoolArray
    """(m,): false for bars of frames that were left out."""

    @property
    def mean_reprojection_px(self) -> float:
        """Mean over the kept pairs with a value; NaN if there are none."""
        return _mean(self.reprojection_px[self.kept_pairs])

    @property
    def mean_length(self) -> float:
        """Mean relative length error over the kept bars with a value; NaN if there are none."""
        return _mean(self.length[self.kept_bars])

    @property
    def p95_length(self) -> float:
        """95th percentile of the relative length error; NaN if there are no values."""
        known = self.length[self.kept_bars & np.isfinite(self.length)]
        return float(np.percentile(known, 95)) if len(known) else float("nan")


def errors_of(dataset: Dataset, pose: Pose, left_out: Collection[int] = ()) -> Errors:
    """Reprojection and length errors of a pose on a data set.

    Args:
        left_out: numbers of the frames that the means exclude.
    """
    rows = dataset.correspondences
    kept = ~np.isin(rows.frame, list(left_out))
    both = reprojection_errors_of_rays(pose.R, pose.T, dataset.rays, dataset.pixel_scale)
    lengths = dataset.reconstructed_lengths_m(pose)
    measured = dataset.bar_distances_m
    return Errors(
        both.mean(axis=1), np.abs(lengths - measured) / measured, kept, dataset.bars_among(kept)
    )


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")
