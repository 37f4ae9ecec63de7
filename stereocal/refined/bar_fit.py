"""One frame of the refined method: its 3D points, residuals and Jacobian, compiled.

All frames share the unknowns `q` (25,): the five angles, the baseline in metres, the factor of the
bar's length, fx, fy, cx, cy of the primary and of the secondary camera, k1, k2, p1, p2 of the
primary and of the secondary camera, and the time by which the secondary camera is late, in frames,
with its drift in frames per frame. A frame adds the 3D points of its targets, `x` (6,), in metres
in the primary's frame. It has nine residuals: eight pixel coordinates over sigma_px, and the length
|A - B| over the bar's factor minus the stated length, over its scatter. Divided by the factor, a
change of scale changes no residual. Else a smaller scene has smaller errors of lengths: with wide
priors and 20,000 bars the least squares shrank it without end.

`J` has shape (32, 9): the derivatives of the residuals by x and by q in the first 31 rows, the
residuals in the last. Each row belongs to one unknown, so that sums over the residuals read
consecutive memory.
"""

from __future__ import annotations

import numpy as np

from stereocal.refined.distortion import distort, distortion_derivatives
from stereocal.rig.compiled import FloatArray, internal
from stereocal.rig.decompositions import backward, factor, forward

YAW, PITCH, ROLL, DELTA, EPSILON, BASELINE, BAR, PRIMARY, SECONDARY = 0, 1, 2, 3, 4, 5, 6, 7, 11
DISTORTION = 15
"""The first of k1, k2, p1, p2 of the primary; those of the secondary follow."""
TIME, DRIFT = 23, 24
SHARED = 25
OWN = 6
RESIDUALS = 9
SEEN, TIMED = 4, 7
"""Columns of a target's pixels, without and with its motion."""
ALL = OWN + SHARED
ERRORS = ALL
"""The row of J that holds the residuals."""

MAXIMUM_STEPS = 12
TOLERANCE = 1e-6
"""Relative reduction of the sum of squares by a step, below which the points have converged
(measured: the remaining reduction is below 1e-9)."""


@internal
def fill_motions(q: FloatArray, R: FloatArray, motions: FloatArray) -> None:
    """Write the derivatives of coordinates in the secondary's frame by the pose, (6, 3).

    Rows 0 to 2: the axes a of yaw, pitch and roll, with d(R x) = a x (R x). R is a product of
    rotations about y, x and z; the derivative by an angle is a rotation about its axis, rotated by
    the factors to its left. Rows 3 to 5: the derivatives of T by delta, epsilon and baseline.
    """
    cy, sy = np.cos(q[YAW]), np.sin(q[YAW])
    cd, sd = np.cos(q[DELTA]), np.sin(q[DELTA])
    ce, se = np.cos(q[EPSILON]), np.sin(q[EPSILON])
    b = q[BASELINE]
    motions[0, 0], motions[0, 1], motions[0, 2] = 0.0, 1.0, 0.0
    motions[1, 0], motions[1, 1], motions[1, 2] = cy, 0.0, -sy
    motions[2, 0], motions[2, 1], motions[2, 2] = R[0, 2], R[1, 2], R[2, 2]
    motions[3, 0], motions[3, 1], motions[3, 2] = -b * sd * ce, -b * sd * se, b * cd
    motions[4, 0], motions[4, 1], motions[4, 2] = -b * cd * se, b * cd * ce, 0.0
    motions[5, 0], motions[5, 1], motions[5, 2] = cd * ce, cd * se, sd


@internal
def fill_residuals(
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    derivatives: FloatArray,
    J: FloatArray,
) -> float:
    """Write the residuals of a frame and their derivatives by x to J.

    Args:
        lenses: (2, 23): skew and `distortion.lens_terms` of each camera, with the k1, k2, p1, p2
            of q.
        pixels: (2, 4): of each target u, v in the primary and in the secondary; NaN for a target
            that was not seen, whose residuals are 0. Or (2, 7), with the velocity of the secondary
            point in pixels per frame, and the frame from which the drift counts.
        weight: 1 / sigma_px.
        length_weight: 1 / scatter of the bar's length; 0 leaves the length out.
        derivatives: (8, 5), written: of each pixel coordinate its derivatives by the point in the
            camera's frame, and along the same axis the coordinates of the distorted and of the
            undistorted point.

    Returns:
        The sum of squares; infinite if a target is behind a camera.
    """
    zero_rows(J, 0, OWN)
    zero_rows(J, ERRORS, ERRORS + 1)
    for target in range(2):
        if np.isnan(pixels[target, 0]):
            continue
        at = 3 * target
        a, b, c = x[at], x[at + 1], x[at + 2]
        sx = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + T[0]
        sy = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + T[1]
        sz = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + T[2]
        if not (c > 0.0 and sz > 0.0):
            return np.inf
        for camera in range(2):
            if camera == 1:
                a, b, c = sx, sy, sz
            row, own = 4 * target + 2 * camera, PRIMARY + 4 * camera
            fx, fy, skew, near = q[own], q[own + 1], lenses[camera, 0], 1.0 / c
            nx, ny = a * near, b * near
            bx, by, xx, xy, yx, yy = distort(nx, ny, lenses, camera)
            u, v = pixels[target, 2 * camera], pixels[target, 2 * camera + 1]
            if camera == 1 and pixels.shape[1] == TIMED:
                late = q[TIME] + q[DRIFT] * pixels[target, 6]
                u -= late * pixels[target, 4]
                v -= late * pixels[target, 5]
            J[ERRORS, row] = weight * (fx * bx + skew * by + q[own + 2] - u)
            J[ERRORS, row + 1] = weight * (fy * by + q[own + 3] - v)
            scale = weight * near
            ux, uy = scale * (fx * xx + skew * yx), scale * (fx * xy + skew * yy)
            vx, vy = scale * fy * yx, scale * fy * yy
            derivatives[row, 0], derivatives[row, 1], derivatives[row, 3] = ux, uy, bx
            derivatives[row + 1, 0], derivatives[row + 1, 1], derivatives[row + 1, 3] = vx, vy, by
            derivatives[row, 4], derivatives[row + 1, 4] = nx, ny
            derivatives[row, 2], derivatives[row + 1, 2] = (
                -(ux * nx + uy * ny),
                -(vx * nx + vy * ny),
            )
            fill_point_derivatives(R, derivatives, row, at, J)
    if length_weight > 0.0:
        length_residual(q[BAR], distance, length_weight, x, J)
    total = 0.0
    for k in range(RESIDUALS):
        total += J[ERRORS, k] * J[ERRORS, k]
    return total


@internal
def fill_point_derivatives(
    R: FloatArray, derivatives: FloatArray, row: int, at: int, J: FloatArray
) -> None:
    """Write the derivatives of two pixel coordinates by the point in the primary's frame."""
    for k in range(row, row + 2):
        p, s, t = derivatives[k, 0], derivatives[k, 1], derivatives[k, 2]
        for j in range(3):
            if row % 4 == 0:
                J[at + j, k] = derivatives[k, j]
            else:
                J[at + j, k] = p * R[0, j] + s * R[1, j] + t * R[2, j]


@internal
def zero_rows(J: FloatArray, first: int, end: int) -> None:
    """Set the rows `first` to `end` - 1 of J to 0."""
    for row in range(first, end):
        for k in range(RESIDUALS):
            J[row, k] = 0.0


@internal
def length_residual(
    bar_factor: float, distance: float, weight: float, x: FloatArray, J: FloatArray
) -> None:
    """Write the residual of the bar's length and its derivatives by x."""
    square = 0.0
    for j in range(3):
        square += (x[j] - x[j + 3]) ** 2
    length = np.sqrt(square)
    J[ERRORS, 8] = weight * (length / bar_factor - distance)
    for j in range(3):
        J[j, 8] = weight / (bar_factor * length) * (x[j] - x[j + 3])
        J[j + 3, 8] = -J[j, 8]


@internal
def fill_shared_derivatives(
    q: FloatArray,
    R: FloatArray,
    motions: FloatArray,
    lenses: FloatArray,
    bent: bool,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    derivatives: FloatArray,
    J: FloatArray,
) -> None:
    """Write the derivatives by q to J, after `fill_residuals` with the same arguments.

    Args:
        bent: whether those by the distortion are wanted; else they are 0.
    """
    zero_rows(J, OWN, ALL)
    by_lens = np.empty((2, 4))
    for target in range(2):
        if np.isnan(pixels[target, 0]):
            continue
        for k in range(4 * target, 4 * target + 4):
            vertical = k % 2
            own = OWN + PRIMARY + 4 * (k % 4 // 2) + vertical
            J[own, k], J[own + 2, k] = weight * derivatives[k, 3], weight
            if k % 4 > 1 and pixels.shape[1] == TIMED:
                J[OWN + TIME, k] = weight * pixels[target, SEEN + vertical]
                J[OWN + DRIFT, k] = J[OWN + TIME, k] * pixels[target, 6]
        for camera in range(2 if bent else 0):
            k, own = 4 * target + 2 * camera, OWN + DISTORTION + 4 * camera
            fx, fy = q[PRIMARY + 4 * camera], q[PRIMARY + 4 * camera + 1]
            nx, ny = derivatives[k, 4], derivatives[k + 1, 4]
            distortion_derivatives(nx, ny, lenses, camera, by_lens)
            for i in range(4):
                along_x, along_y = weight * by_lens[0, i], weight * by_lens[1, i]
                J[own + i, k] = fx * along_x + lenses[camera, 0] * along_y
                J[own + i, k + 1] = fy * along_y
        a, b, c = x[3 * target], x[3 * target + 1], x[3 * target + 2]
        yx = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c
        yy = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c
        yz = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c
        for k in range(4 * target + 2, 4 * target + 4):
            p, s, t = derivatives[k, 0], derivatives[k, 1], derivatives[k, 2]
            # derivative . (axis x y) = axis . (y x derivative)
            m0, m1, m2 = yy * t - yz * s, yz * p - yx * t, yx * s - yy * p
            for i in range(3):
                turn = motions[i, 0] * m0 + motions[i, 1] * m1 + motions[i, 2] * m2
                shift = motions[i + 3, 0] * p + motions[i + 3, 1] * s + motions[i + 3, 2] * t
                J[OWN + i, k], J[OWN + 3 + i, k] = turn, shift
    if length_weight > 0.0:
        J[OWN + BAR, 8] = -(J[ERRORS, 8] + length_weight * distance) / q[BAR]


@internal
def normal_matrix(J: FloatArray, pixels: FloatArray, V: FloatArray) -> None:
    """Write the lower half of J_x J_x^T (6, 6), with a diagonal of 1 for a target not seen.

    The two targets are coupled only by the length.
    """
    for i in range(OWN):
        for j in range(i + 1):
            V[i, j] = row_product(J, i, j) if i // 3 == j // 3 else J[i, 8] * J[j, 8]
        if np.isnan(pixels[i // 3, 0]):
            V[i, i] = 1.0


@internal
def row_product(J: FloatArray, i: int, row: int) -> float:
    """Row i of J_x times another row of J: four pixel coordinates and the length."""
    first = 4 * (i // 3)
    total: float = J[i, 8] * J[row, 8]
    for k in range(first, first + 4):
        total += J[i, k] * J[row, k]
    return total


@internal
def fit_points(
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    derivatives: FloatArray,
    J: FloatArray,
    V: FloatArray,
) -> float:
    """Minimise the sum of squares over x (Levenberg-Marquardt), in place; return the minimum.

    On return, `derivatives` and J are those at the minimum.
    """
    best = fill_residuals(
        q, R, T, lenses, pixels, distance, weight, length_weight, x, derivatives, J
    )
    if not best < np.inf:
        return np.inf
    step, tried, damping = np.empty(OWN), np.empty(OWN), 0.0
    for _ in range(MAXIMUM_STEPS):
        normal_matrix(J, pixels, V)
        for i in range(OWN):
            V[i, i] *= 1.0 + damping
            step[i] = row_product(J, i, ERRORS)
        if not factor(V, 0.0):
            break
        forward(V, step)
        gain = 0.0
        for i in range(OWN):
            gain += step[i] * step[i]
        backward(V, step)
        for i in range(OWN):
            tried[i] = x[i] - step[i]
        found = fill_residuals(
            q, R, T, lenses, pixels, distance, weight, length_weight, tried, derivatives, J
        )
        if found <= best:
            best = found
            for i in range(OWN):
                x[i] = tried[i]
            damping *= 0.1
        else:
            damping = max(10.0 * damping, 1e-3)
            fill_residuals(
                q, R, T, lenses, pixels, distance, weight, length_weight, x, derivatives, J
            )
        if gain < TOLERANCE * (1.0 + best):
            break  # converged, or limited by rounding
    return best
