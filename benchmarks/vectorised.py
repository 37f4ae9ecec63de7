"""The costs and the essential method in NumPy as fast as NumPy goes: a row of numbers at a time.

`tests.calibration.reference` is written to be right, and solves a 3x3 system for each point. A
ratio against it would flatter the compiled code, so the ratios are taken against this.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import least_squares

from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import Angles, Pose, angles_of


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


def essential(rays: FloatArray, baseline: float, constrained: bool) -> Pose:
    """The 8-point estimate, and from there SciPy's minimum of the squared residuals."""
    p, of_p = _normalised(rays[:2])
    q, of_q = _normalised(rays[2:])
    F = np.linalg.svd(np.einsum("in,jn->nij", q, p).reshape(-1, 9))[2][8].reshape(3, 3)
    u, _, vt = np.linalg.svd(of_q.T @ F @ of_p)
    u, vt = u * np.linalg.det(u), vt * np.linalg.det(vt)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    _, R, t = max(
        (
            (int(np.isfinite(triangulate(R, t, rays)[0]).sum()), R, t)
            for R in (u @ turn @ vt, u @ turn.T @ vt)
            for t in (u[:, 2], -u[:, 2])
        ),
        key=lambda pose: pose[0],
    )
    if not constrained:
        return Pose(R, baseline * t)
    # All residuals are linear in the 9 numbers of E: the triangle has the same sum of squares.
    ones = np.ones(rays.shape[1])
    A = np.einsum("in,jn->nij", np.vstack([rays[2:], ones]), np.vstack([rays[:2], ones]))
    r = np.linalg.qr(A.reshape(-1, 9), mode="r")

    def residuals(angles: FloatArray) -> FloatArray:
        pose = Pose.from_angles(Angles(*angles), 1.0)
        x, y, z = pose.T
        E = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ pose.R
        value: FloatArray = r @ E.ravel()
        return value

    found = least_squares(residuals, np.array(angles_of(R, t)), method="lm")
    return Pose.from_angles(Angles(*found.x), baseline)


def _normalised(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Homogeneous points (3, n) about 0 with a mean square of 1 along each axis, and the map."""
    mean = points.mean(axis=1)
    scale = 1.0 / np.sqrt(((points - mean[:, None]) ** 2).mean())
    T = np.array([[scale, 0.0, -scale * mean[0]], [0.0, scale, -scale * mean[1]], [0, 0, 1]])
    return T @ np.vstack([points, np.ones(points.shape[1])]), T
