"""The noise of a robust fit, and the chi-square above which a frame is an outlier."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri, fdtri

from stereocal.system.array_types import FloatArray, IntArray

GIVEN, ESTIMATED = "given", "estimated from the residuals"
ASSUMED = "assumed, for there are too few points to estimate it"
SCATTER_SIGNIFICANCE = 0.05
"""Significance level of the test whether the bar's length varies."""
OUTLIER_PROBABILITY = 1e-5
"""Probability that a good frame exceeds the limit."""
THIRD = 1 / 3
"""Robust scales use this quantile: with 3 of 10 points wrong, half of the frames are bad."""
LARGEST_LOG_RATIO, BISECTIONS = 20.7, 24
"""Range of the logarithm of a variance, a factor of 1e9, and halvings of it: to 1e-6."""


@dataclass(frozen=True)
class Noise:
    """A standard deviation and its source: `GIVEN`, `ESTIMATED` or `ASSUMED`."""

    value: float
    source: str


def unit_freedom(pixels: FloatArray) -> IntArray:
    """(n,): degrees of freedom of the pixels (n, 2, c, 2) of units: two for each image of a point,
    less three for the point."""
    views = np.isfinite(pixels[..., 0]).sum(axis=2)
    return np.asarray(np.where(views > 0, 2 * views - 3, 0).sum(axis=1))


def frame_limits(freedom: IntArray, frame_of: IntArray, unknowns: int) -> FloatArray:
    """(f,): the chi-square above which a frame is an outlier, by `limits_of`.

    The points of one placing have errors that are alike: it is judged by their mean, as one unit.

    Args:
        freedom: (n,), of each unit; frame_of: (n,), the index of its frame.
    """
    of_frame = np.bincount(frame_of, freedom)
    largest = np.zeros(len(of_frame), np.int64)
    np.maximum.at(largest, frame_of, freedom)
    with np.errstate(invalid="ignore"):
        return limits_of(largest, unknowns) * (of_frame / largest)


def limits_of(degrees_of_freedom: IntArray, unknowns: int) -> FloatArray:
    """(n,): the chi-square above which a frame is an outlier.

    The noise is estimated from the same frames. Chi-square over degrees of freedom therefore
    follows the F distribution: with 25 bars the limit is 26 instead of 21.

    Args:
        degrees_of_freedom: (n,), of each frame.
        unknowns: number of unknowns.
    """
    left = max(int(degrees_of_freedom.sum()) - unknowns, 1)
    degrees = np.where(degrees_of_freedom > 0, degrees_of_freedom, np.nan)
    return np.asarray(degrees * fdtri(degrees, left, 1.0 - OUTLIER_PROBABILITY))


def thirds_of(degrees_of_freedom: IntArray) -> FloatArray:
    """(n,): the quantile `THIRD` of chi-square; NaN for 0 degrees of freedom."""
    degrees = np.where(degrees_of_freedom > 0, degrees_of_freedom, np.nan)
    return np.asarray(chdtri(degrees, 1 - THIRD))


def scatter_of(
    innovations: FloatArray, variances: FloatArray, spent: float = 0.0, robust: bool = False
) -> float:
    """The scatter of the bar's length beyond the noise of the pixels, in metres.

    Solves sum(e^2 / (scatter^2 + v)) = n - spent (Mandel and Paule), or, if `robust`, the same for
    the lower third. Returns 0 unless the sum without scatter is significant at the level
    `SCATTER_SIGNIFICANCE`. Otherwise half of all rigid bars would get a scatter, and the standard
    error of the scale would be too large (measured with 25 frames: errors of the baseline are 0.93
    of the stated ones, and 0.97 with the test).

    Args:
        innovations: (n,): e, reconstructed minus stated lengths, in metres.
        variances: (n,): v, the variances of e from the pixels, in square metres.
        spent: degrees of freedom of the lengths used by the unknowns.
    """
    squares = np.square(innovations)
    left = max(len(squares) - spent, 1.0)
    if len(squares) < 2 or not float(np.sum(squares / variances)) > chdtri(
        left, SCATTER_SIGNIFICANCE
    ):
        return 0.0
    third = float(chdtri(1.0, 1 - THIRD)) if robust else 0.0
    return float(np.sqrt(_excess_variance(squares, variances, left, third)))


def _excess_variance(
    squares: FloatArray, variances: FloatArray, left: float, third: float
) -> float:
    """The variance c for which sum(squares / (c + variances)) is `left`, by bisection of its log.

    Args:
        third: if not 0, c is that for which the lower third of the terms is this.
    """
    high = float(np.log(10.0 * len(squares) * squares.max()))
    low = high - LARGEST_LOG_RATIO
    rank = (len(squares) - 1) // 3
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        terms = squares / (np.exp(middle) + variances)
        small = np.partition(terms, rank)[rank] > third if third > 0.0 else terms.sum() > left
        low, high = (middle, high) if small else (low, middle)
    return float(np.exp(0.5 * (low + high)))


def lower_third(values: FloatArray) -> Any:
    """The lower third quantile; values may be infinite."""
    return np.quantile(values, THIRD, method="lower")
