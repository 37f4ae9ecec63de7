"""Frames that stand out: a mixed-up target, a moved bar, a misread point."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from stereocal.calibration.methods import Method
from stereocal.refined.results import Calibration
from stereocal.rig.compiled import FloatArray, IntArray

SPREADS = 6.0
"""A frame stands out beyond the median by so many robust standard deviations (1.4826 MAD)."""

MAD_TO_SIGMA = 1.4826
SMALLEST_EXCESS_PX = 0.01
"""No image point is known better: without it, data free of noise would have outlying frames."""
SMALLEST_EXCESS_LENGTH = 1e-5
"""The same for lengths, as a fraction."""


def frame_reprojection_px(calibration: Calibration, method: Method) -> FloatArray:
    """(f,): of each frame of the data set the larger reprojection error of its targets.

    NaN where a target of the frame has no value.
    """
    rows = calibration.dataset.correspondences
    worst = np.full(len(rows.frames), -np.inf)
    at = np.searchsorted(rows.frames, rows.frame)
    with np.errstate(invalid="ignore"):  # NumPy 1 warns of NaN
        np.maximum.at(worst, at, calibration.errors[method].reprojection_px)
    return worst


def bar_frames(calibration: Calibration) -> IntArray:
    """(m,): the frame of each bar, in the order of `Errors.length`."""
    rows = calibration.dataset.correspondences
    return rows.frame[rows.bars[:, 0]]


def held_out(calibration: Calibration, frames: IntArray) -> npt.NDArray[np.bool_]:
    """(f,): true for the frames that were neither calibrated with nor left out."""
    return np.isin(frames, calibration.held_out_frames)


def left_out(calibration: Calibration, frames: IntArray) -> npt.NDArray[np.bool_]:
    """(f,): true for the frames that were left out, since they contradict the others."""
    return np.isin(frames, calibration.screening.left_out)


def outlying(values: FloatArray, smallest_excess: float) -> npt.NDArray[np.bool_]:
    """(n,): true for values far above the median, and for those that could not be computed."""
    known = values[np.isfinite(values)]
    if not len(known):
        return np.isnan(values)
    median = np.median(known)
    spread = MAD_TO_SIGMA * np.median(np.abs(known - median))
    limit = median + max(SPREADS * spread, smallest_excess)
    usual: npt.NDArray[np.bool_] = values <= limit
    return ~usual


def reprojection_outliers(calibration: Calibration) -> list[int]:
    """Frames whose reprojection error stands out with the 2D set, in order."""
    found = outlying(frame_reprojection_px(calibration, "2d"), SMALLEST_EXCESS_PX)
    return [int(frame) for frame in calibration.dataset.correspondences.frames[found]]


def length_outliers(calibration: Calibration) -> list[int]:
    """Frames whose length error stands out with the 3D set, in order."""
    found = outlying(calibration.errors["3d"].length, SMALLEST_EXCESS_LENGTH)
    return [int(frame) for frame in bar_frames(calibration)[found]]


def outlying_frames(calibration: Calibration) -> list[int]:
    """Frames that stand out in the images (2D set) or in length (3D set), in order.

    A frame with a point that cannot be reconstructed in front of both cameras stands out too.
    """
    return sorted({*reprojection_outliers(calibration), *length_outliers(calibration)})
