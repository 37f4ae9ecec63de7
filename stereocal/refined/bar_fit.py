"""One frame of the refined method: where its targets are, given the rig, and what that costs.

The unknowns that all frames share are `q`, 15 numbers: the five angles, the baseline in metres, the
factor of the bar's length, and fx, fy, cx, cy of the primary and of the secondary camera. A frame
adds the places of its targets, `x`: six numbers in metres, in the primary's frame. Its residuals
are nine: eight pixel coordinates over sigma_px, and the length |A - B| less the bar's over its
scatter. Their slopes by x and then by q are the first 21 rows of `J`, shape (22, 9), and they
themselves the last: a row is one unknown, because sums run over residuals, and those of a row lie
side by side in memory.
"""

from __future__ import annotations

import numpy as np

from stereocal.refined.distortion import bend
from stereocal.rig.compiled import FloatArray, internal
from stereocal.rig.decompositions import backward, factor, forward

YAW, PITCH, ROLL, DELTA, EPSILON, BASELINE, BAR, PRIMARY, SECONDARY = 0, 1, 2, 3, 4, 5, 6, 7, 11
SHARED = 15
OWN = 6
RESIDUALS = 9
ALL = OWN + SHARED
ERRORS = ALL
"""The row of J that holds the residuals."""

MOST_STEPS = 12
SETTLED = 1e-6
"""The places are found when a step was to lower the sum of squares by less; what is left then is
the square of a small number smaller (measured: below 1e-9)."""


@internal
def fill_motions(q: FloatArray, R: FloatArray, motions: FloatArray) -> None:
    """How the secondary's coordinates move with the pose: `motions`, shape (6, 3).

    Rows 0 to 2: axes a of yaw, pitch, roll, with d(R x) = a x (R x): R is a product of turns about
    y, x and z, so the derivative by each angle is a turn about that axis as the turns to its left
    have moved it. Rows 3 to 5: dT by delta, epsilon, baseline.
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
def residuals_of(
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    slopes: FloatArray,
    J: FloatArray,
) -> float:
    """Write the residuals of a frame and their slopes by x to J; return the sum of squares.

    Infinite where a target is behind a camera. NaN pixels are a target that was not seen: its
    residuals are 0.

    Args:
        lenses: (2, 23): skew and `distortion.lens_terms` of each camera.
        pixels: (2, 4): for each target u, v in the primary and in the secondary.
        weight: 1 / sigma_px.
        length_weight: 1 / scatter of the bar's length; 0 leaves the length out.
        slopes: (8, 4), written: of each pixel coordinate its slopes by the point in the camera's
            frame, and the bent point's coordinate along the same axis.
    """
    clear(J, 0, OWN)
    clear(J, ERRORS, ERRORS + 1)
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
            bx, by, xx, xy, yx, yy = bend(nx, ny, lenses, camera)
            u, v = pixels[target, 2 * camera], pixels[target, 2 * camera + 1]
            J[ERRORS, row] = weight * (fx * bx + skew * by + q[own + 2] - u)
            J[ERRORS, row + 1] = weight * (fy * by + q[own + 3] - v)
            scale = weight * near
            ux, uy = scale * (fx * xx + skew * yx), scale * (fx * xy + skew * yy)
            vx, vy = scale * fy * yx, scale * fy * yy
            slopes[row, 0], slopes[row, 1], slopes[row, 3] = ux, uy, bx
            slopes[row + 1, 0], slopes[row + 1, 1], slopes[row + 1, 3] = vx, vy, by
            slopes[row, 2], slopes[row + 1, 2] = -(ux * nx + uy * ny), -(vx * nx + vy * ny)
            place_slopes(R, slopes, row, at, J)
    if length_weight > 0.0:
        length_residual(q[BAR] * distance, length_weight, x, J)
    total = 0.0
    for k in range(RESIDUALS):
        total += J[ERRORS, k] * J[ERRORS, k]
    return total


@internal
def place_slopes(R: FloatArray, slopes: FloatArray, row: int, at: int, J: FloatArray) -> None:
    """Write the slopes of two pixel coordinates by the place, which is in the primary's frame."""
    for k in range(row, row + 2):
        p, s, t = slopes[k, 0], slopes[k, 1], slopes[k, 2]
        for j in range(3):
            if row % 4 == 0:
                J[at + j, k] = slopes[k, j]
            else:
                J[at + j, k] = p * R[0, j] + s * R[1, j] + t * R[2, j]


@internal
def clear(J: FloatArray, first: int, end: int) -> None:
    """Zeros in some rows of J."""
    for row in range(first, end):
        for k in range(RESIDUALS):
            J[row, k] = 0.0


@internal
def length_residual(expected: float, weight: float, x: FloatArray, J: FloatArray) -> None:
    """Write the residual of the bar's length and its slopes by x."""
    square = 0.0
    for j in range(3):
        square += (x[j] - x[j + 3]) ** 2
    length = np.sqrt(square)
    J[ERRORS, 8] = weight * (length - expected)
    for j in range(3):
        J[j, 8] = weight / length * (x[j] - x[j + 3])
        J[j + 3, 8] = -J[j, 8]


@internal
def shared_slopes(
    R: FloatArray,
    motions: FloatArray,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    slopes: FloatArray,
    J: FloatArray,
) -> None:
    """Write the slopes by q to J, after `residuals_of` with the same arguments."""
    clear(J, OWN, ALL)
    for target in range(2):
        if np.isnan(pixels[target, 0]):
            continue
        for k in range(4 * target, 4 * target + 4):
            vertical = k % 2
            own = OWN + PRIMARY + 4 * (k % 4 // 2) + vertical
            J[own, k], J[own + 2, k] = weight * slopes[k, 3], weight
        a, b, c = x[3 * target], x[3 * target + 1], x[3 * target + 2]
        yx = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c
        yy = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c
        yz = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c
        for k in range(4 * target + 2, 4 * target + 4):
            p, s, t = slopes[k, 0], slopes[k, 1], slopes[k, 2]
            # slope . (axis x y) = axis . (y x slope)
            m0, m1, m2 = yy * t - yz * s, yz * p - yx * t, yx * s - yy * p
            for i in range(3):
                turn = motions[i, 0] * m0 + motions[i, 1] * m1 + motions[i, 2] * m2
                shift = motions[i + 3, 0] * p + motions[i + 3, 1] * s + motions[i + 3, 2] * t
                J[OWN + i, k], J[OWN + 3 + i, k] = turn, shift
    J[OWN + BAR, 8] = -length_weight * distance if length_weight > 0.0 else 0.0


@internal
def normal_matrix(J: FloatArray, pixels: FloatArray, V: FloatArray) -> None:
    """J_x J_x^T, (6, 6), the lower half; 1 in the diagonal for a target that was not seen.

    Only the length joins the two targets.
    """
    for i in range(OWN):
        for j in range(i + 1):
            V[i, j] = descent(J, i, j) if i // 3 == j // 3 else J[i, 8] * J[j, 8]
        if np.isnan(pixels[i // 3, 0]):
            V[i, i] = 1.0


@internal
def descent(J: FloatArray, i: int, row: int) -> float:
    """Row i of J_x times another row of J: four pixel coordinates and the length."""
    first = 4 * (i // 3)
    total: float = J[i, 8] * J[row, 8]
    for k in range(first, first + 4):
        total += J[i, k] * J[row, k]
    return total


@internal
def settle(
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    slopes: FloatArray,
    J: FloatArray,
    V: FloatArray,
) -> float:
    """Move x to the places of least sum of squares, by Levenberg-Marquardt; return that sum.

    `slopes` and J are left as they are there.
    """
    best = residuals_of(
        q, R, T, lenses, pixels, distance, weight, length_weight, x, slopes, J
    )  # fmt: skip
    if not best < np.inf:
        return np.inf
    step, tried, damping = np.empty(OWN), np.empty(OWN), 0.0
    for _ in range(MOST_STEPS):
        normal_matrix(J, pixels, V)
        for i in range(OWN):
            V[i, i] *= 1.0 + damping
            step[i] = descent(J, i, ERRORS)
        if not factor(V, 0.0):
            break
        forward(V, step)
        gain = 0.0
        for i in range(OWN):
            gain += step[i] * step[i]
        backward(V, step)
        for i in range(OWN):
            tried[i] = x[i] - step[i]
        found = residuals_of(
            q, R, T, lenses, pixels, distance, weight, length_weight, tried, slopes, J
        )
        if found <= best:
            best = found
            for i in range(OWN):
                x[i] = tried[i]
            damping *= 0.1
        else:
            damping = max(10.0 * damping, 1e-3)
            residuals_of(q, R, T, lenses, pixels, distance, weight, length_weight, x, slopes, J)
        if gain < SETTLED * (1.0 + best):
            break  # found, or what is left is rounding
    return best
