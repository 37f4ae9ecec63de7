"""The costs in NumPy as fast as NumPy goes: a row of numbers at a time.

`tests.calibration.reference` is written to be right, and solves a 3x3 system for each point. A
ratio against it would flatter the compiled code, so the ratios are taken against this.
"""

import numpy as np

from stereocal.system.array_types import FloatArray


def triangulate(R: FloatArray, T: FloatArray, rays: FloatArray) -> FloatArray:
    """Midpoints in the primary frame, shape (3, n); NaN for parallel rays or behind a camera."""
    p = np.empty((3, rays.shape[1]))
    q = np.empty((3, rays.shape[1]))
    p[:2], p[2] = rays[:2], 1.0
    q[:2], q[2] = rays[2:], 1.0
    d = R @ p
    pp = (p * p).sum(axis=0)
    qq = (q * q).sum(axis=0)
    pq = (d * q).sum(axis=0)
    pt, qt = T @ d, T @ q
    sine_squared = pp * qq - pq * pq
    s = (pq * qt - qq * pt) / sine_squared
    r = (pp * qt - pq * pt) / sine_squared
    in_secondary = 0.5 * (T[:, None] + s * d + r * q)
    points: FloatArray = R.T @ (in_secondary - T[:, None])
    lost = (sine_squared < 1e-14 * pp * qq) | (points[2] <= 0.0) | (in_secondary[2] <= 0.0)
    if lost.any():
        points[:, lost] = np.nan
    return points


def reprojection_cost(
    R: FloatArray, T: FloatArray, rays: FloatArray, pixel_scale: FloatArray
) -> float:
    """Sum of the reprojection errors over pairs and cameras, in pixels."""
    points = triangulate(R, T, rays)
    first = points[:2] / points[2] - rays[:2]
    moved = R @ points + T[:, None]
    second = moved[:2] / moved[2] - rays[2:]
    return _pixels(first, pixel_scale[0]) + _pixels(second, pixel_scale[1])


def distance_cost(R: FloatArray, T: FloatArray, rays: FloatArray, reference: FloatArray) -> float:
    """Sum over bars of the difference between measured and reconstructed length, in metres."""
    points = triangulate(R, T, rays)
    bars = reference.shape[1]
    along = points[:, :bars] - points[:, bars:]
    return float(np.abs(reference[0] - np.sqrt((along * along).sum(axis=0))).sum())


def points_cost(R: FloatArray, T: FloatArray, rays: FloatArray, reference: FloatArray) -> float:
    """Sum of the distances between known and reconstructed points, in metres."""
    off = triangulate(R, T, rays) - reference
    return float(np.sqrt((off * off).sum(axis=0)).sum())


def _pixels(shift: FloatArray, scale: FloatArray) -> float:
    u = scale[0] * shift[0] + scale[1] * shift[1]
    v = scale[2] * shift[1]
    return float(np.sqrt(u * u + v * v).sum())
