"""Outlying frames: exchanged targets, a moved bar, a wrong point."""

import numpy as np
import numpy.typing as npt

from stereocal.calibration.methods import Method
from stereocal.fit.results import Calibration
from stereocal.system.array_types import FloatArray, IntArray

OUTLIER_SIGMAS = 6.0
"""A value is an outlier if it exceeds the median by this many robust standard deviations."""

MAD_TO_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, for normal numbers."""
SMALLEST_EXCESS_PX = 0.01
"""Least excess of an outlier over the median. No image point is more precise than this; without the
limit, noise-free data would have outliers."""
SMALLEST_EXCESS_LENGTH = 1e-5
"""The same for relative length errors."""


def frame_reprojection_px(calibration: Calibration, method: Method) -> FloatArray:
    """(f,): the larger reprojection error of the two targets of each frame, in pixels.

    NaN if a target of the frame has none.
    """
    rows = calibration.dataset.correspondences
    worst = np.full(len(rows.frames), -np.inf)
    frame_of = np.searchsorted(rows.frames, rows.frame)
    with np.errstate(invalid="ignore"):  # NumPy 1 warns about NaN
        np.maximum.at(worst, frame_of, calibration.errors[method].reprojection_px)
    return worst


def bar_frames(calibration: Calibration) -> IntArray:
    """(m,): the frame number of each bar, in the order of `Errors.length`."""
    rows = calibration.dataset.correspondences
    return rows.frame[rows.bars[:, 0]]


def outlying(values: FloatArray, smallest_excess: float) -> npt.NDArray[np.bool_]:
    """(n,): true for NaN and for values far above the median.

    Args:
        values: (n,).
        smallest_excess: values closer to the median than this are never outliers.
    """
    known = values[np.isfinite(values)]
    if not len(known):
        return np.isnan(values)
    median = np.median(known)
    spread = MAD_TO_SIGMA * np.median(np.abs(known - median))
    limit = median + max(OUTLIER_SIGMAS * spread, smallest_excess)
    inliers: npt.NDArray[np.bool_] = values <= limit
    return ~inliers


def reprojection_outliers(calibration: Calibration) -> list[int]:
    """Numbers of the frames whose reprojection error with the 2D set is an outlier, ascending."""
    outliers = outlying(frame_reprojection_px(calibration, "2d"), SMALLEST_EXCESS_PX)
    return [int(frame) for frame in calibration.dataset.correspondences.frames[outliers]]


def length_outliers(calibration: Calibration) -> list[int]:
    """Numbers of the frames whose length error with the 3D set is an outlier, ascending."""
    outliers = outlying(calibration.errors["3d"].length, SMALLEST_EXCESS_LENGTH)
    return [int(frame) for frame in bar_frames(calibration)[outliers]]


def outlying_frames(calibration: Calibration) -> list[int]:
    """Numbers of the frames that are outliers in reprojection (2D set) or length (3D set).

    A frame with a point that is not reconstructed in front of both cameras is an outlier too.
    """
    return sorted({*reprojection_outliers(calibration), *length_outliers(calibration)})
