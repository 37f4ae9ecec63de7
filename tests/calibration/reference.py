"""The paper's costs in plain NumPy, as an independent check of the compiled ones.

Nothing here is taken from `stereocal.rig.geometry`: a point is found by solving for the point
nearest to both rays, not by the closed form, and it is projected by the paper's matrices. Shapes as
in `stereocal.calibration.costs`: `rays` is (4, n) with rows x_primary, y_primary, x_secondary,
y_secondary, `pixel_scale` is (2, 3) with a row fx, skew, fy for each camera. Lengths in metres.
"""

import numpy as np

from stereocal.system.array_types import FloatArray

SMALLEST_SINE = 1e-7
"""Rays closer than this to parallel have no crossing (the documented limit of `geometry`)."""


def triangulate(R: FloatArray, T: FloatArray, rays: FloatArray) -> FloatArray:
    """The paper's Q^R in the primary frame, shape (n, 3); NaN for parallel rays or behind a camera.

    Q^R is the point with the least sum of squared distances to both rays (Section 2.3), which is
    the middle of their shortest segment. With a unit direction d, `P = I - d d^T` takes the part
    across the ray, so Q^R solves `(P1 + P2) Q = P1 0 + P2 C`, C the secondary's centre.
    """
    centre = -R.T @ T
    first, second = _directions(rays[:2]), _directions(rays[2:]) @ R  # rows: R^T q
    across_first, across_second = _across(first), _across(second)
    parallel = np.linalg.norm(np.cross(first, second), axis=1) < SMALLEST_SINE
    system = np.where(parallel[:, None, None], np.eye(3), across_first + across_second)
    nearest = np.linalg.solve(system, (across_second @ centre)[:, :, None])
    points = np.asarray(nearest[:, :, 0], dtype=np.float64)
    behind = (points[:, 2] <= 0) | ((points @ R.T + T)[:, 2] <= 0)
    points[parallel | behind] = np.nan
    return points


def reprojection_cost(
    R: FloatArray, T: FloatArray, rays: FloatArray, pixel_scale: FloatArray
) -> float:
    """Sum over pairs and both cameras of |q - q^R| in pixels (paper, eq. 6)."""
    points = triangulate(R, T, rays)
    total = 0.0
    for seen, found, (fx, skew, fy) in (
        (rays[:2], points, pixel_scale[0]),
        (rays[2:], points @ R.T + T, pixel_scale[1]),
    ):
        K = np.array([[fx, skew], [0.0, fy]])
        shift = K @ (found[:, :2] / found[:, 2:]).T - K @ seen
        total += float(np.sqrt((shift**2).sum(axis=0)).sum())
    return total


def distance_cost(R: FloatArray, T: FloatArray, rays: FloatArray, reference: FloatArray) -> float:
    """Sum over bars of |D - D^R| in metres; `reference` is (1, m), ends A then ends B in `rays`."""
    points = triangulate(R, T, rays)
    bars = reference.shape[1]
    lengths = np.linalg.norm(points[:bars] - points[bars : 2 * bars], axis=1)
    return float(np.abs(reference[0] - lengths).sum())


def points_cost(R: FloatArray, T: FloatArray, rays: FloatArray, reference: FloatArray) -> float:
    """Sum over points of |Q - Q^R| in metres; `reference` is (3, n) (paper, footnote 4)."""
    return float(np.linalg.norm(triangulate(R, T, rays) - reference.T, axis=1).sum())


def _directions(points: FloatArray) -> FloatArray:
    """Unit vectors (n, 3) along the rays of normalised points (2, n)."""
    along = np.column_stack([points.T, np.ones(points.shape[1])])
    unit: FloatArray = along / np.linalg.norm(along, axis=1, keepdims=True)
    return unit


def _across(directions: FloatArray) -> FloatArray:
    """`I - d d^T` of unit vectors (n, 3), shape (n, 3, 3)."""
    outer: FloatArray = np.eye(3) - directions[:, :, None] * directions[:, None, :]
    return outer
