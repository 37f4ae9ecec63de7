"""The paper's two costs and their derivatives by pose and lenses, compiled.

The 2D cost is a sum of norms |e| of errors in the images, the 3D cost a sum of |D - D^R|. Both are
smoothed as sqrt(|e|^2 + h^2) with a small h and minimised by iteratively reweighted least squares
with the weights 1 / sqrt(|e|^2 + h^2). The derivatives of the errors are central differences, for
which the rays are updated to first order with the Jacobian of the lens.
"""

import numpy as np

from stereocal.refined.distortion import FISHEYE, TILTED, distort
from stereocal.refined.two_views import BASELINE, PRIMARY, SECONDARY
from stereocal.rig.compiled import compiled, internal
from stereocal.rig.geometry import fill_pose, midpoint
from stereocal.system.array_types import FloatArray, IntArray


@compiled
def fill_errors(
    q: FloatArray,
    lenses: FloatArray,
    rays: FloatArray,
    bars: IntArray,
    distances: FloatArray,
    errors: FloatArray,
) -> None:
    """Write the errors (4 n + m,): u, v in both cameras of n pairs in pixels, then m lengths."""
    R, T = np.empty((3, 3)), np.empty(3)
    fill_pose(q, q[BASELINE], R, T)
    n = rays.shape[1]
    points = np.empty((n, 3))
    for k in range(n):
        xp, yp, xs, ys = rays[0, k], rays[1, k], rays[2, k], rays[3, k]
        x1, y1, z1, x2, y2, z2 = midpoint(R, T, xp, yp, xs, ys)
        points[k, 0], points[k, 1], points[k, 2] = x1, y1, z1
        dx, dy = x1 / z1 - xp, y1 / z1 - yp
        errors[4 * k] = q[PRIMARY] * dx + lenses[0, 0] * dy
        errors[4 * k + 1] = q[PRIMARY + 1] * dy
        dx, dy = x2 / z2 - xs, y2 / z2 - ys
        errors[4 * k + 2] = q[SECONDARY] * dx + lenses[1, 0] * dy
        errors[4 * k + 3] = q[SECONDARY + 1] * dy
    for camera in range(2):
        if lenses[camera, 1 + TILTED] == FISHEYE:
            _fill_recorded(q, R, T, lenses, camera, rays, points, errors)
    for j in range(len(bars)):
        a, b = points[bars[j, 0]], points[bars[j, 1]]
        square = (a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2
        errors[4 * n + j] = np.sqrt(square) - distances[j]


@internal
def _fill_recorded(
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    lenses: FloatArray,
    camera: int,
    rays: FloatArray,
    points: FloatArray,
    errors: FloatArray,
) -> None:
    """Write the errors of a fisheye, which are differences in the recorded image."""
    at, row = PRIMARY + 4 * camera, 2 * camera
    for k in range(rays.shape[1]):
        a, b, c = points[k, 0], points[k, 1], points[k, 2]
        if camera == 1:
            a, b, c = (
                R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + T[0],
                R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + T[1],
                R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + T[2],
            )
        u, v, _, _, _, _ = distort(a / c, b / c, lenses, camera)
        seen_u, seen_v, _, _, _, _ = distort(rays[row, k], rays[row + 1, k], lenses, camera)
        errors[4 * k + row] = q[at] * (u - seen_u) + lenses[camera, 0] * (v - seen_v)
        errors[4 * k + row + 1] = q[at + 1] * (v - seen_v)


@compiled
def move_rays(
    q: FloatArray,
    moved_q: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    inverse_jacobians: FloatArray,
    moved: FloatArray,
) -> None:
    """Write the rays (4, n) to `moved` for the lenses of `moved_q`, close to q, to first order."""
    for camera in range(2):
        at = PRIMARY if camera == 0 else SECONDARY
        skew, row = lenses[camera, 0], 2 * camera
        for k in range(rays.shape[1]):
            u, v = pixels[k, row], pixels[k, row + 1]
            by, moved_by = (v - q[at + 3]) / q[at + 1], (v - moved_q[at + 3]) / moved_q[at + 1]
            bx = (u - q[at + 2] - skew * by) / q[at]
            du = (u - moved_q[at + 2] - skew * moved_by) / moved_q[at] - bx
            dv = moved_by - by
            s = inverse_jacobians[k, camera]
            moved[row, k] = rays[row, k] + s[0] * du + s[1] * dv
            moved[row + 1, k] = rays[row + 1, k] + s[2] * du + s[3] * dv


def sizes_of(errors: FloatArray, pairs: int) -> tuple[FloatArray, FloatArray]:
    """(2 pairs,) and (m,): the norms of the errors in the images, and the errors of the lengths."""
    in_images = errors[: 4 * pairs].reshape(-1, 2)
    return np.linalg.norm(in_images, axis=1), np.abs(errors[4 * pairs :])


def jacobian(
    q: FloatArray,
    M: FloatArray,
    steps: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    inverse_jacobians: FloatArray,
    bars: IntArray,
    distances: FloatArray,
) -> FloatArray:
    """(k, errors): derivatives of all errors by the free parameters."""
    moved, J = np.empty(rays.shape), np.empty((2, len(steps), 4 * len(pixels) + len(bars)))
    for side, signed in zip(J, (steps, -steps), strict=True):
        for errors, along in zip(side, signed[:, None] * M.T, strict=True):
            move_rays(q, q + along, lenses, pixels, rays, inverse_jacobians, moved)
            fill_errors(q + along, lenses, moved, bars, distances, errors)
    return np.asarray((J[0] - J[1]) / (2.0 * steps[:, None]))
