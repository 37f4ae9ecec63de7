"""The paper's two costs and their derivatives by pose and lenses, compiled.

The 2D cost is a sum of norms |e| of errors in the images, the 3D cost a sum of |D - D^R|. Both are
smoothed as sqrt(|e|^2 + h^2) with a small h and minimised by iteratively reweighted least squares
with the weights 1 / sqrt(|e|^2 + h^2). The derivatives of the errors are central differences, for
which the rays are updated to first order with the Jacobian of the lens.
"""

import numpy as np

from stereocal.refined.distortion import FISHEYE, TILTED, distort
from stereocal.refined.two_views import BASELINE, PRIMARY, SECONDARY
from stereocal.rig.compiled import FloatArray, IntArray, compiled, internal
from stereocal.rig.geometry import fill_pose, midpoint


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


@compiled
def weigh(
    errors: FloatArray,
    pairs: int,
    weight_2d: float,
    weight_3d: float,
    smooth_px: float,
    smooth_m: float,
    weights: FloatArray,
) -> tuple[float, float, float]:
    """Write the weight of each error.

    Returns:
        The smoothed objective, the 2D cost in pixels, and the 3D cost in metres.
    """
    objective = cost_2d = cost_3d = 0.0
    for k in range(2 * pairs):
        square = errors[2 * k] ** 2 + errors[2 * k + 1] ** 2
        smooth = np.sqrt(square + smooth_px * smooth_px)
        cost_2d += np.sqrt(square)
        objective += weight_2d * smooth
        weights[2 * k] = weights[2 * k + 1] = weight_2d / smooth
    for k in range(4 * pairs, len(errors)):
        smooth = np.sqrt(errors[k] ** 2 + smooth_m * smooth_m)
        cost_3d += abs(errors[k])
        objective += weight_3d * smooth
        weights[k] = weight_3d / smooth
    return objective, cost_2d, cost_3d


@compiled
def fill_jacobian(
    q: FloatArray,
    M: FloatArray,
    steps: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    inverse_jacobians: FloatArray,
    bars: IntArray,
    distances: FloatArray,
    J: FloatArray,
) -> None:
    """Write the derivatives of all errors by the free parameters to J (k, errors)."""
    moved_q, moved = np.empty(len(q)), np.empty(rays.shape)
    lower = np.empty(J.shape[1])
    for j in range(M.shape[1]):
        for side in range(2):
            step = steps[j] if side else -steps[j]
            for i in range(len(q)):
                moved_q[i] = q[i] + step * M[i, j]
            move_rays(q, moved_q, lenses, pixels, rays, inverse_jacobians, moved)
            fill_errors(moved_q, lenses, moved, bars, distances, J[j] if side else lower)
        for i in range(J.shape[1]):
            J[j, i] = (J[j, i] - lower[i]) / (2.0 * steps[j])
