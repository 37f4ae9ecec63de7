"""All pairs of two point sets within a reprojection error: the hot loop of matching."""

import numpy as np

from stereocal.rig.compiled import compiled, contiguous
from stereocal.rig.geometry import reprojection_shift
from stereocal.system.array_types import FloatArray, IntArray


def pairs_within(
    R: FloatArray,
    T: FloatArray,
    primary: FloatArray,
    secondary: FloatArray,
    pixel_scale: FloatArray,
    threshold: float,
    near: float,
    far: float,
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Pairs of n and m points whose reprojection error is at most `threshold`.

    All n x m pairs are tried, 5 ns each: 5 ms for a frame of 1,000 x 1,000 points. The error of a
    pair is the mean over both cameras, in pixels (paper, eq. 6). Pairs whose point is behind a
    camera or outside the depth range are excluded.

    Args:
        primary: (n, 2) normalised points; `secondary`: (m, 2).
        pixel_scale: (2, 3), as in `geometry.reprojection_shift`.
        near: least depth z in the primary's frame, in metres; `far`: the largest.

    Returns:
        Row of the primary, row of the secondary, and error of each of the k pairs found; then
        (n, 2) least and second least error of each primary point over all pairs, inf if there is
        none; then (m, 2) the same for the secondary points.
    """
    of_primary = np.full((len(primary), 2), np.inf)
    of_secondary = np.full((len(secondary), 2), np.inf)
    candidates = _pairs_within(
        contiguous(R),
        contiguous(T),
        contiguous(primary),
        contiguous(secondary.T),
        contiguous(pixel_scale),
        float(threshold),
        float(near),
        float(far),
        of_primary,
        of_secondary,
    )
    rows = candidates[:, :2].astype(np.int64)
    return rows[:, 0], rows[:, 1], candidates[:, 2].copy(), of_primary, of_secondary


@compiled
def _pairs_within(
    R: FloatArray,
    T: FloatArray,
    primary: FloatArray,
    secondary: FloatArray,
    pixel_scale: FloatArray,
    threshold: float,
    near: float,
    far: float,
    of_primary: FloatArray,
    of_secondary: FloatArray,
) -> FloatArray:
    """(k, 3): row of the primary, row of the secondary, and error of each pair.

    Fills `of_primary` and `of_secondary`. `secondary` is (2, m) here, contiguous by coordinate.
    """
    n, m = len(primary), secondary.shape[1]
    candidates = np.empty((4 * m + 16, 3))
    row = np.empty(m)
    count = 0
    for i in range(n):
        xp, yp = primary[i, 0], primary[i, 1]
        # Separate from the sorting below, so that this loop is vectorised.
        for j in range(m):
            one, two, z = reprojection_shift(
                R, T, xp, yp, secondary[0, j], secondary[1, j], pixel_scale
            )
            keep = 1.0 if (z >= near) & (z <= far) else np.nan
            row[j] = 0.5 * (one + two) * keep
        if count + m > len(candidates):
            candidates = _enlarged(candidates, count, 2 * len(candidates) + m)
        least, next_least = np.inf, np.inf
        for j in range(m):
            error = row[j]
            if error < next_least:
                next_least = error
                if error < least:
                    least, next_least = error, least
            if error < of_secondary[j, 1]:
                of_secondary[j, 1] = error
                if error < of_secondary[j, 0]:
                    of_secondary[j, 1], of_secondary[j, 0] = of_secondary[j, 0], error
            if error <= threshold:
                candidates[count, 0], candidates[count, 1], candidates[count, 2] = i, j, error
                count += 1
        of_primary[i, 0], of_primary[i, 1] = least, next_least
    return _enlarged(candidates, count, count)


@compiled
def _enlarged(candidates: FloatArray, count: int, size: int) -> FloatArray:
    larger = np.empty((size, 3))
    for k in range(count):
        for i in range(3):
            larger[k, i] = candidates[k, i]
    return larger
