"""What one method found, and how it fits a data set."""

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
"""A set that measures 5 % of the bars worse than this is not one to measure with."""


@dataclass(frozen=True, eq=False)
class MethodResult:
    """The pose that one method found, and how."""

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
    """How a pose fits the data set, frame by frame; the means are of the frames not left out."""

    reprojection_px: FloatArray
    """(n,), per pair the mean over both cameras; NaN where the point is behind a camera."""
    length: FloatArray
    """(m,), per bar |D - D^R| / D, a fraction; NaN likewise."""
    kept_pairs: BoolArray
    """(n,): false for the pairs of frames that were left out."""
    kept_bars: BoolArray
    """(m,): the same for bars."""

    @property
    def mean_reprojection_px(self) -> float:
        """Mean over the pairs that have a value; NaN if none has."""
        return _mean(self.reprojection_px[self.kept_pairs])

    @property
    def mean_length(self) -> float:
        """Mean relative length error over the bars that have a value; NaN if none has."""
        return _mean(self.length[self.kept_bars])

    @property
    def p95_length(self) -> float:
        """The relative length error that 95 % of the bars stay below; NaN if none has one."""
        known = self.length[self.kept_bars & np.isfinite(self.length)]
        return float(np.percentile(known, 95)) if len(known) else float("nan")


def errors_of(dataset: Dataset, pose: Pose, left_out: Collection[int] = ()) -> Errors:
    """Reprojection and length errors of a pose on a data set.

    Args:
        left_out: numbers of frames that the means are without.
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
