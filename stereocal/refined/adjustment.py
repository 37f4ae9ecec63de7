"""The refined method's least squares over all frames, compiled.

For each q (see `bar_fit`) the places of the targets are found frame by frame; the least sum of
squares of a frame, s(q), depends on q alone. The cost is the sum of rho(s) over the frames plus the
priors. Its normal equations come from the frame's Jacobian with the places eliminated (Schur
complement), so that time and memory grow with the frames and not with their square.
"""

from __future__ import annotations

import numpy as np

from stereocal.compiled import FloatArray, compiled
from stereocal.decompositions import backward, factor, forward
from stereocal.geometry import fill_pose, midpoint
from stereocal.refined.bar_fit import (
    ALL,
    EPSILON,
    OWN,
    RESIDUALS,
    SHARED,
    descent,
    fill_motions,
    normal_matrix,
    residuals_of,
    settle,
)

CONVERGED = 1e-9
"""A solve ends with a step that was to lower the cost by less: 3e-5 standard errors."""
ROUGHLY = 1e-2
"""The same while the limit still comes down: a tenth of a standard error."""


@compiled
def loss(s: float, limit: float) -> tuple[float, float]:
    """Tukey's biweight rho(s) of a sum of squares, and its slope, the frame's weight.

    rho is s near 0 and constant above `limit`: such a frame has no say. An infinite limit is plain
    least squares, a limit of 0 leaves the frame out.
    """
    if limit == np.inf:
        return s, 1.0
    if not s < limit:
        return limit / 3.0, 0.0
    left = 1.0 - s / limit
    return limit / 3.0 * (1.0 - left * left * left), left * left


@compiled
def sums(
    q: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    distances: FloatArray,
    weight: float,
    length_weight: float,
    limits: FloatArray,
    places: FloatArray,
    misfits: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> float:
    """Cost of all frames; writes places (n, 6), misfits s (n,), H (15, 15) and g (15,).

    H and g are those of the places at their best: J J^T and J r with x eliminated.

    Args:
        pixels: (n, 2, 4), NaN for a target that was not seen.
        rays: (n, 2, 4): the same undistorted with the stated lenses, where places must be started.
        distances: (n,), NaN without a bar.
    """
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q[: EPSILON + 1], q[5], R, T)
    fill_motions(q, R, motions)
    r, J, V = np.empty(RESIDUALS), np.empty((ALL, RESIDUALS)), np.empty((OWN, OWN))
    Y = np.empty((SHARED + 1, OWN))
    H[:, :] = 0.0
    g[:] = 0.0
    cost = 0.0
    for f in range(len(pixels)):
        x = places[f]
        own = 0.0 if np.isnan(distances[f]) else length_weight
        if np.isnan(x).any():
            start(R, T, rays[f], x)
        s = settle(q, R, T, motions, lenses, pixels[f], distances[f], weight, own, x, r, J, V)
        misfits[f] = s
        rho, w = loss(s, limits[f])
        cost += rho
        if not s < np.inf:
            x[:] = np.nan
        elif w > 0.0:
            residuals_of(
                q, R, T, motions, lenses, pixels[f], distances[f], weight, own, x, True, r, J
            )
            normal_matrix(J, pixels[f], 0.0, V)
            if factor(V, OWN):
                eliminate(J, r, V, w, Y, H, g)
    for i in range(SHARED):
        for j in range(i):
            H[j, i] = H[i, j]
    return cost


@compiled
def start(R: FloatArray, T: FloatArray, rays: FloatArray, x: FloatArray) -> None:
    """Midpoints of the targets seen; far in front of the camera for one that was not."""
    for target in range(2):
        at = 3 * target
        if np.isnan(rays[target, 0]):
            x[at], x[at + 1], x[at + 2] = 0.0, 0.0, 1.0
        else:
            x[at], x[at + 1], x[at + 2], _, _, _ = midpoint(
                R, T, rays[target, 0], rays[target, 1], rays[target, 2], rays[target, 3]
            )


@compiled
def eliminate(
    J: FloatArray,
    r: FloatArray,
    L: FloatArray,
    w: float,
    Y: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> None:
    """Add w times the Schur complement of a frame to H (lower half) and g.

    With J_x J_x^T = L L^T and y = L^-1 J_x J_q^T: H = J_q J_q^T - y^T y.
    """
    for j in range(SHARED):
        for i in range(OWN):
            Y[j, i] = descent(J, i, J[OWN + j])
        forward(L, Y[j], OWN)
    z = Y[SHARED]
    for i in range(OWN):
        z[i] = descent(J, i, r)
    forward(L, z, OWN)
    for i in range(SHARED):
        a, y = J[OWN + i], Y[i]
        for j in range(i + 1):
            b = J[OWN + j]
            total = 0.0
            for k in range(RESIDUALS):
                total += a[k] * b[k]
            for k in range(OWN):
                total -= y[k] * Y[j, k]
            H[i, j] += w * total
        total = 0.0
        for k in range(RESIDUALS):
            total += a[k] * r[k]
        for k in range(OWN):
            total -= y[k] * z[k]
        g[i] += w * total


@compiled
def adjust(
    origin: FloatArray,
    M: FloatArray,
    precision: FloatArray,
    p: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    distances: FloatArray,
    weight: float,
    length_weight: float,
    limits: FloatArray,
    places: FloatArray,
    misfits: FloatArray,
    H: FloatArray,
    tolerance: float,
    most_steps: int,
) -> tuple[float, int, bool]:
    """Levenberg-Marquardt over the free numbers p, with q = origin + M p; in place.

    The prior of p is normal about 0 with the given precision (0: none). Returns the cost with the
    priors, the number of steps tried, and whether it converged.
    """
    k = len(p)
    q, g = np.empty(SHARED), np.empty(SHARED)
    trial_p, trial_places, trial_misfits = np.empty(k), places.copy(), misfits.copy()
    trial_H, trial_g = np.empty((SHARED, SHARED)), np.empty(SHARED)
    A, L, b, d = np.empty((k, k)), np.empty((k, k)), np.empty(k), np.empty(k)
    fill_shared(origin, M, p, q)
    cost = sums(
        q, lenses, pixels, rays, distances, weight, length_weight, limits, places, misfits, H, g
    ) + prior_cost(p, precision)
    damping = 1e-5
    for step in range(1, most_steps + 1):
        normal_equations(H, g, M, p, precision, A, b)
        L[:, :] = A
        for i in range(k):
            L[i, i] *= 1.0 + damping
        if not factor(L, k):
            return cost, step, False
        d[:] = b
        forward(L, d, k)
        gain = 0.0
        for i in range(k):
            gain += d[i] * d[i]
        backward(L, d, k)
        for i in range(k):
            trial_p[i] = p[i] - d[i]
        fill_shared(origin, M, trial_p, q)
        trial_places[:, :] = places
        trial = sums(
            q, lenses, pixels, rays, distances, weight, length_weight, limits, trial_places,
            trial_misfits, trial_H, trial_g,
        ) + prior_cost(trial_p, precision)  # fmt: skip
        if trial <= cost:
            cost = trial
            p[:], places[:, :], misfits[:] = trial_p, trial_places, trial_misfits
            H[:, :], g[:] = trial_H, trial_g
            damping *= 0.05
            if gain < tolerance:
                return cost, step, True
        else:
            if gain < 1e-6:  # rounding, or the error that is left in the places
                return cost, step, True
            damping = max(20.0 * damping, 1e-4)
    return cost, most_steps, False


@compiled
def fill_shared(origin: FloatArray, M: FloatArray, p: FloatArray, q: FloatArray) -> None:
    """q = origin + M p."""
    for i in range(SHARED):
        q[i] = origin[i]
        for j in range(len(p)):
            q[i] += M[i, j] * p[j]


@compiled
def prior_cost(p: FloatArray, precision: FloatArray) -> float:
    """Sum of the squared deviations from the stated values, in standard deviations."""
    total = 0.0
    for i in range(len(p)):
        total += precision[i] * p[i] * p[i]
    return total


@compiled
def normal_equations(
    H: FloatArray,
    g: FloatArray,
    M: FloatArray,
    p: FloatArray,
    precision: FloatArray,
    A: FloatArray,
    b: FloatArray,
) -> None:
    """A = M^T H M + precision, b = M^T g + precision p."""
    for i in range(len(p)):
        b[i] = precision[i] * p[i]
        for r in range(SHARED):
            b[i] += M[r, i] * g[r]
        for j in range(len(p)):
            total = 0.0
            for r in range(SHARED):
                if M[r, i] != 0.0:
                    for s in range(SHARED):
                        total += M[r, i] * H[r, s] * M[s, j]
            A[i, j] = total
        A[i, i] += precision[i]


@compiled
def length_innovations(
    q: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    distances: FloatArray,
    weight: float,
    places: FloatArray,
    found: FloatArray,
) -> None:
    """Write to `found`, (n, 2), what the pixels alone say of each bar's length.

    Column 0: the length of the bar at `places`, which must be those of the pixels alone, less the
    stated one, in metres. Column 1: its variance from the noise of the pixels, in square metres:
    l^T (J_x J_x^T)^-1 l, where l is the slope of the length. NaN where there is no bar.
    """
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q[: EPSILON + 1], q[5], R, T)
    fill_motions(q, R, motions)
    r, J, V = np.empty(RESIDUALS), np.empty((ALL, RESIDUALS)), np.empty((OWN, OWN))
    slope = np.empty(OWN)
    found[:, :] = np.nan
    for f in range(len(pixels)):
        if np.isnan(distances[f]) or np.isnan(places[f]).any():
            continue
        s = residuals_of(
            q, R, T, motions, lenses, pixels[f], distances[f], weight, 1.0, places[f], False, r, J
        )
        if not s < np.inf:
            continue
        slope[:] = J[:OWN, 8]
        J[:OWN, 8] = 0.0
        normal_matrix(J, pixels[f], 0.0, V)
        if factor(V, OWN):
            forward(V, slope, OWN)
            found[f, 0] = r[8]
            found[f, 1] = (slope * slope).sum()


@compiled
def point_slopes(
    q: FloatArray, lenses: FloatArray, weight: float, points: FloatArray, slopes: FloatArray
) -> None:
    """Write `slopes`, (n, 18, 4), of the pixels of points (n, 3): by the place and by q.

    In units of 1 / `weight` pixels. NaN behind a camera.
    """
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q[: EPSILON + 1], q[5], R, T)
    fill_motions(q, R, motions)
    r, J, x = np.empty(RESIDUALS), np.empty((ALL, RESIDUALS)), np.zeros(OWN)
    pixels = np.full((2, 4), np.nan)
    pixels[0] = 0.0
    for k in range(len(points)):
        x[:3] = points[k]
        s = residuals_of(q, R, T, motions, lenses, pixels, 0.0, weight, 0.0, x, True, r, J)
        for i in range(4):
            for j in range(3):
                slopes[k, j, i] = J[j, i] if s < np.inf else np.nan
            for j in range(SHARED):
                slopes[k, 3 + j, i] = J[OWN + j, i] if s < np.inf else np.nan
