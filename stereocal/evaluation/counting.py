"""The test of a validation run (paper, Section 6), compiled: count the errors of all pairs."""

import numpy as np

from stereocal.rig.compiled import compiled
from stereocal.rig.geometry import apart_m, midpoints, reprojection_shift
from stereocal.rig.rig import Rig
from stereocal.system.array_types import CountArray, FloatArray, IntArray

LOWEST, HIGHEST, BIN_WIDTH = -12.0, 6.0, 0.02
"""Range of the bins in log10, and their width."""
BINS = round((HIGHEST - LOWEST) / BIN_WIDTH)
UNDERFLOW, OVERFLOW = BINS, BINS + 1
"""Two more counters: for values below the range or 0, and for values above it or NaN."""
RESIDUAL, REPROJECTION = 0, 1
WRONG, CORRECT = 0, 1


@compiled
def count_pairs(
    R: FloatArray,
    T: FloatArray,
    E: FloatArray,
    rays: FloatArray,
    pixel_scale: FloatArray,
    partners: IntArray,
    counts: CountArray,
    nans: IntArray,
) -> float:
    """Add |residual| and reprojection error of all pairs to `counts`, and the NaN to `nans`.

    Args:
        rays: (4, n).
        partners: (n, p): the secondary points paired with each primary point.
        counts: (2, 2, BINS + 2): residual, reprojection; wrong, correct; bin.
        nans: (2,): wrong, correct.

    Returns:
        The mean reprojection error of the correct pairs with a value, in pixels; NaN if none has.
    """
    total, known = 0.0, 0
    xp, yp, xs, ys = rays[0], rays[1], rays[2], rays[3]
    for i in range(partners.shape[0]):
        a = E[0, 0] * xp[i] + E[0, 1] * yp[i] + E[0, 2]
        b = E[1, 0] * xp[i] + E[1, 1] * yp[i] + E[1, 2]
        c = E[2, 0] * xp[i] + E[2, 1] * yp[i] + E[2, 2]
        for k in range(partners.shape[1]):
            j = partners[i, k]
            label = CORRECT if i == j else WRONG
            counts[RESIDUAL, label, bin_of(abs(xs[j] * a + ys[j] * b + c))] += 1
            first, second, _ = reprojection_shift(R, T, xp[i], yp[i], xs[j], ys[j], pixel_scale)
            error = 0.5 * (first + second)
            if np.isnan(error):
                nans[label] += 1
            elif label == CORRECT:
                total += error
                known += 1
            counts[REPROJECTION, label, bin_of(error)] += 1
    return total / known


def count_pairs_behind_windows(
    rig: Rig, pixels: FloatArray, partners: IntArray, counts: CountArray, nans: IntArray
) -> float:
    """`count_pairs` of cameras that look through windows: the residual is the distance of both
    rays, in metres.

    Args:
        pixels: (n, 4): u and v in both images.
    """
    primary = np.repeat(np.arange(len(partners)), partners.shape[1])
    secondary = partners.ravel()
    one, one_along, other, other_along = rig.rays_between(pixels[:, :2], pixels[:, 2:])
    rays = one[primary], one_along[primary], other[secondary], other_along[secondary]
    both = rig.image_errors(midpoints(*rays), pixels[primary, :2], pixels[secondary, 2:])
    errors, residuals, correct = both.mean(axis=1), np.abs(apart_m(*rays)), primary == secondary
    for label in (WRONG, CORRECT):
        among = correct == bool(label)
        _count(residuals[among], counts[RESIDUAL, label])
        _count(errors[among], counts[REPROJECTION, label])
        nans[label] += np.count_nonzero(np.isnan(errors[among]))
    known = errors[correct & np.isfinite(errors)]
    return float(known.mean()) if len(known) else float("nan")


@compiled
def _count(values: FloatArray, counts: CountArray) -> None:
    for k in range(len(values)):
        counts[bin_of(values[k])] += 1


@compiled
def bin_of(value: float) -> int:
    if np.isnan(value):
        return OVERFLOW
    if value <= 0.0:
        return UNDERFLOW
    index = np.floor((np.log10(value) - LOWEST) / BIN_WIDTH)
    if index < 0.0:
        return UNDERFLOW
    return OVERFLOW if index >= BINS else int(index)
