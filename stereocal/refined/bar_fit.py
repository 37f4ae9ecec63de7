"""One frame of the refined method: where its targets are, given the rig, and what that costs.

The unknowns that all frames share are `q`, 15 numbers: the five angles, the baseline in metres, the
factor of the bar's length, and fx, fy, cx, cy of the primary and of the secondary camera. A frame
adds the places of its targets, `x`: six numbers in metres, in the primary's frame. Its residuals
are nine: eight pixel coordinates over sigma_px, and the length |A - B| less the bar's over its
scatter. Their slopes by x and then by q are the 21 rows of `J`, shape (21, 9): a row is one
unknown, because sums run over residuals, and those of a row lie side by side in memory.
"""

from __future__ import annotations

import numpy as np

from stereocal.compiled import FloatArray, compiled
from stereocal.decompositions import backward, factor, forward
from stereocal.refined.distortion import bend

YAW, PITCH, ROLL, DELTA, EPSILON, BASELINE, BAR, PRIMARY, SECONDARY = 0, 1, 2, 3, 4, 5, 6, 7, 11
SHARED = 15
OWN = 6
RESIDUALS = 9
ALL = OWN + SHARED

MOST_STEPS = 12
SETTLED = 1e-6
"""The places are found when a step was to lower the sum of squares by less; what is left then is
the square of a small number smaller (measured: below 1e-9)."""


@compiled
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


@compiled
def see(
    x: float,
    y: float,
    z: float,
    u: float,
    v: float,
    lens: FloatArray,
    skew: float,
    terms: FloatArray,
    weight: float,
    row: int,
    r: FloatArray,
    slopes: FloatArray,
) -> tuple[float, float]:
    """The two residuals of a point of a camera's frame, and in `slopes` (2, 3) theirs by the point.

    Returns the bent point.
    """
    near = 1.0 / z
    nx, ny = x * near, y * near
    bx, by, xx, xy, yx, yy = bend(nx, ny, terms)
    r[row] = weight * (lens[0] * bx + skew * by + lens[2] - u)
    r[row + 1] = weight * (lens[1] * by + lens[3] - v)
    scale = weight * near
    ux, uy = scale * (lens[0] * xx + skew * yx), scale * (lens[0] * xy + skew * yy)
    vx, vy = scale * lens[1] * yx, scale * lens[1] * yy
    slopes[0, 0], slopes[0, 1], slopes[0, 2] = ux, uy, -(ux * nx + uy * ny)
    slopes[1, 0], slopes[1, 1], slopes[1, 2] = vx, vy, -(vx * nx + vy * ny)
    return bx, by


@compiled
def target_residuals(
    target: int,
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    motions: FloatArray,
    lenses: FloatArray,
    seen: FloatArray,
    weight: float,
    x: FloatArray,
    whole: bool,
    slopes: FloatArray,
    r: FloatArray,
    J: FloatArray,
) -> bool:
    """Write the four residuals of a target and their slopes; false behind a camera."""
    at, row = 3 * target, 4 * target
    a, b, c = x[at], x[at + 1], x[at + 2]
    yx = R[0, 0] * a + R[0, 1] * b + R[0, 2] * c
    yy = R[1, 0] * a + R[1, 1] * b + R[1, 2] * c
    yz = R[2, 0] * a + R[2, 1] * b + R[2, 2] * c
    sx, sy, sz = yx + T[0], yy + T[1], yz + T[2]
    if not (c > 0.0 and sz > 0.0):
        return False
    bx, by = see(
        a, b, c, seen[0], seen[1], q[PRIMARY : PRIMARY + 4],
        lenses[0, 0], lenses[0, 1:], weight, row, r, slopes,
    )  # fmt: skip
    for i in range(2):
        for j in range(3):
            J[at + j, row + i] = slopes[i, j]
    if whole:
        lens_slopes(J, row, OWN + PRIMARY, weight, bx, by)
    row += 2
    bx, by = see(
        sx, sy, sz, seen[2], seen[3], q[SECONDARY : SECONDARY + 4],
        lenses[1, 0], lenses[1, 1:], weight, row, r, slopes,
    )  # fmt: skip
    for i in range(2):
        p, s, t = slopes[i, 0], slopes[i, 1], slopes[i, 2]
        for j in range(3):
            J[at + j, row + i] = p * R[0, j] + s * R[1, j] + t * R[2, j]
        if whole:
            # slope . (axis x y) = axis . (y x slope)
            m0, m1, m2 = yy * t - yz * s, yz * p - yx * t, yx * s - yy * p
            for k in range(3):
                turn, shift = motions[k], motions[k + 3]
                J[OWN + k, row + i] = turn[0] * m0 + turn[1] * m1 + turn[2] * m2
                J[OWN + 3 + k, row + i] = shift[0] * p + shift[1] * s + shift[2] * t
    if whole:
        lens_slopes(J, row, OWN + SECONDARY, weight, bx, by)
    return True


@compiled
def residuals_of(
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    motions: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    whole: bool,
    r: FloatArray,
    J: FloatArray,
) -> float:
    """Write the residuals r (9,) of a frame and their slopes J (21, 9); return the sum of squares.

    Infinite where a target is behind a camera. NaN pixels are a target that was not seen: its
    residuals are 0. Without `whole` only the slopes by x are written.

    Args:
        lenses: (2, 23): skew and `distortion.lens_terms` of each camera.
        pixels: (2, 4): for each target u, v in the primary and in the secondary.
        weight: 1 / sigma_px.
        length_weight: 1 / scatter of the bar's length; 0 leaves the length out.
    """
    J[: ALL if whole else OWN] = 0.0
    r[:] = 0.0
    slopes = np.empty((2, 3))
    for target in range(2):
        seen = pixels[target]
        if not np.isnan(seen[0]) and not target_residuals(
            target, q, R, T, motions, lenses, seen, weight, x, whole, slopes, r, J
        ):
            return np.inf
    if length_weight > 0.0:
        dx, dy, dz = x[0] - x[3], x[1] - x[4], x[2] - x[5]
        length = np.sqrt(dx * dx + dy * dy + dz * dz)
        r[8] = length_weight * (length - q[BAR] * distance)
        scale = length_weight / length
        J[0, 8], J[1, 8], J[2, 8] = scale * dx, scale * dy, scale * dz
        J[3, 8], J[4, 8], J[5, 8] = -scale * dx, -scale * dy, -scale * dz
        if whole:
            J[OWN + BAR, 8] = -length_weight * distance
    total = 0.0
    for i in range(RESIDUALS):
        total += r[i] * r[i]
    return total


@compiled
def lens_slopes(J: FloatArray, row: int, at: int, weight: float, bx: float, by: float) -> None:
    """Slopes of two residuals by fx, fy, cx, cy."""
    J[at, row] = weight * bx
    J[at + 2, row] = weight
    J[at + 1, row + 1] = weight * by
    J[at + 3, row + 1] = weight


@compiled
def normal_matrix(J: FloatArray, pixels: FloatArray, damping: float, V: FloatArray) -> None:
    """J_x J_x^T, (6, 6), the diagonal raised by `damping`; 1 for a target that was not seen.

    Only the length joins the two targets. Only the lower half is written.
    """
    for target in range(2):
        at, row = 3 * target, 4 * target
        unseen = np.isnan(pixels[target, 0])
        for i in range(at, at + 3):
            for j in range(at):
                V[i, j] = J[i, 8] * J[j, 8]
            for j in range(at, i + 1):
                total = J[i, 8] * J[j, 8]
                for k in range(4):
                    total += J[i, row + k] * J[j, row + k]
                V[i, j] = total
            V[i, i] = 1.0 if unseen else V[i, i] * (1.0 + damping)


@compiled
def descent(J: FloatArray, i: int, other: FloatArray) -> float:
    """Row i of J_x times (9,) residuals or a row of J: four pixel coordinates and the length."""
    row = 0 if i < 3 else 4
    total: float = J[i, 8] * other[8]
    for k in range(4):
        total += J[i, row + k] * other[row + k]
    return total


@compiled
def settle(
    q: FloatArray,
    R: FloatArray,
    T: FloatArray,
    motions: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    r: FloatArray,
    J: FloatArray,
    V: FloatArray,
) -> float:
    """Move x to the places of least sum of squares, by Levenberg-Marquardt; return that sum."""
    best = residuals_of(
        q, R, T, motions, lenses, pixels, distance, weight, length_weight, x, False, r, J
    )
    if not best < np.inf:
        return np.inf
    step, tried = np.empty(OWN), np.empty(OWN)
    damping = 0.0
    for _ in range(MOST_STEPS):
        normal_matrix(J, pixels, damping, V)
        for i in range(OWN):
            step[i] = descent(J, i, r)
        if not factor(V, OWN):
            break
        forward(V, step, OWN)
        gain = 0.0
        for i in range(OWN):
            gain += step[i] * step[i]
        backward(V, step, OWN)
        for i in range(OWN):
            tried[i] = x[i] - step[i]
        found = residuals_of(
            q, R, T, motions, lenses, pixels, distance, weight, length_weight, tried, False, r, J
        )
        if found <= best:
            best = found
            x[:] = tried
            damping *= 0.1
            if gain < SETTLED * (1.0 + best):
                break
        else:
            if gain < SETTLED * (1.0 + best):
                break  # rounding: no step lowers the sum
            damping = max(10.0 * damping, 1e-3)
            residuals_of(
                q, R, T, motions, lenses, pixels, distance, weight, length_weight, x, False, r, J
            )
    return best
