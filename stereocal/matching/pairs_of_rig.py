"""All pairs of two point sets by the errors of a rig: in air, and behind windows."""

import numpy as np

from stereocal.fit.least_squares.distortion import distort
from stereocal.fit.least_squares.small_steps import rig_at
from stereocal.fit.least_squares.views import EACH, LENS, Cameras, with_lenses
from stereocal.fit.least_squares.windows import seen_in_air
from stereocal.matching.pair_candidates import pairs_within
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import compiled, contiguous
from stereocal.rig.geometry import AT_ORIGIN, PARALLEL_SINE_SQUARED, Pose, homogeneous
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray, IntArray

PAIRS_AT_ONCE = 1_000_000
"""Behind windows, whose errors are kept in a table."""


def pairs_of(
    rig: Rig, primary: FloatArray, secondary: FloatArray, threshold: float, near: float, far: float
) -> tuple[IntArray, IntArray, FloatArray, FloatArray, FloatArray]:
    """Pairs of n and m points whose reprojection error is at most `threshold`.

    Arguments and results are those of `pair_candidates.pairs_within`; behind windows errors are
    means of `Rig.reprojection_errors`, and a pair takes 0.9 us.

    Args:
        primary: (n, 2) points as of `Camera.rays_of`; `secondary`: (m, 2).
    """
    if not rig.has_windows:
        R, T = rig.pose.R, rig.pose.T
        return pairs_within(R, T, primary, secondary, rig.pixel_scale, threshold, near, far)
    cameras = rig_at(rig)
    one = _seen_and_rays(rig.primary, primary, AT_ORIGIN)
    other = _seen_and_rays(rig.secondary, secondary, rig.pose.inverse())
    found, of_primary = [np.empty((0, 3))], [np.empty((0, 2))]
    of_secondary = np.full((2, len(secondary)), np.inf)
    step = max(PAIRS_AT_ONCE // max(len(secondary), 1), 1)
    for first in range(0, len(primary), step):
        errors = np.empty((len(one[first : first + step]), len(secondary)))
        _fill_behind_windows(cameras, one[first : first + step], other, near, far, errors)
        i, j = np.nonzero(errors <= threshold)
        found.append(np.column_stack([i + first, j, errors[i, j]]))
        errors[np.isnan(errors)] = np.inf
        of_primary.append(_two_least(errors.T).T)
        of_secondary = _two_least(np.vstack([of_secondary, errors]))
    pairs = np.concatenate(found)
    rows = pairs[:, :2].astype(np.int64)
    return rows[:, 0], rows[:, 1], pairs[:, 2], np.concatenate(of_primary), of_secondary.T


def _two_least(errors: FloatArray) -> FloatArray:
    """(2, k): the least and second least of each column of errors (n, k), inf where there is
    none."""
    padded = np.vstack([errors, np.full((2, errors.shape[1]), np.inf)])
    return np.partition(padded, (0, 1), axis=0)[:2]


def _seen_and_rays(camera: Camera, points: FloatArray, to_primary: Pose) -> FloatArray:
    """(n, 8): pixels of points (n, 2) of z = 1, and origins and unit directions of their rays in
    the primary's frame."""
    origins, directions = camera.rays_along(homogeneous(points))
    directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    rays = to_primary.apply(origins), directions @ to_primary.R.T
    return contiguous(np.column_stack([camera.distort(points), *rays]))


@compiled
def _fill_behind_windows(
    stated: Cameras,
    primary: FloatArray,
    secondary: FloatArray,
    near: float,
    far: float,
    errors: FloatArray,
) -> None:
    """Write the errors (n, m) in pixels of all pairs of `_seen_and_rays`, (n, 8) and (m, 8); NaN as
    of `geometry.midpoints`, and for depths z outside a range."""
    cameras, work = with_lenses(stated), np.empty((2, 14))
    between, point = np.empty(3), np.empty(3)
    for i in range(len(primary)):
        a = primary[i]
        for j in range(len(secondary)):
            b = secondary[j]
            one, two, cosine = 0.0, 0.0, 0.0
            for k in range(3):
                between[k] = b[2 + k] - a[2 + k]
                one += between[k] * a[5 + k]
                two += between[k] * b[5 + k]
                cosine += a[5 + k] * b[5 + k]
            sine_squared = 1.0 - cosine * cosine
            s, r = (one - cosine * two) / sine_squared, (cosine * one - two) / sine_squared
            for k in range(3):
                point[k] = 0.5 * (a[2 + k] + s * a[5 + k] + b[2 + k] + r * b[5 + k])
            usable = (sine_squared > PARALLEL_SINE_SQUARED) & (s > 0.0) & (r > 0.0)
            errors[i, j] = np.nan
            if usable and near <= point[2] <= far:
                both = _off(cameras, 0, point, a, work) + _off(cameras, 1, point, b, work)
                errors[i, j] = 0.5 * both


@compiled
def _off(cameras: Cameras, c: int, point: FloatArray, seen: FloatArray, work: FloatArray) -> float:
    """Distance of a point's image in a camera from the pixel (u, v) in `seen`; NaN as of
    `Camera.project`."""
    q, R, lenses, windows = cameras
    first = EACH * c
    x = R[c, 0, 0] * point[0] + R[c, 0, 1] * point[1] + R[c, 0, 2] * point[2] + q[first + 3]
    y = R[c, 1, 0] * point[0] + R[c, 1, 1] * point[1] + R[c, 1, 2] * point[2] + q[first + 4]
    z = R[c, 2, 0] * point[0] + R[c, 2, 1] * point[1] + R[c, 2, 2] * point[2] + q[first + 5]
    x, y, z = seen_in_air(windows, q, R, c, first, x, y, z, work)
    if not z > 0.0:
        return np.nan
    bx, by, _, _, _, _ = distort(x / z, y / z, lenses, c)
    u = q[first + LENS] * bx + lenses[c, 0] * by + q[first + LENS + 2] - seen[0]
    v = q[first + LENS + 1] * by + q[first + LENS + 3] - seen[1]
    return float(np.sqrt(u * u + v * v))
