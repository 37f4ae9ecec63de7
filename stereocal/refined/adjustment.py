"""The refined method's least squares over all frames, compiled.

For each q (see `bar_fit`) the places of the targets are found frame by frame; the least sum of
squares of a frame, s(q), depends on q alone. The cost is the sum of rho(s) over the frames plus the
priors. Its normal equations come from the frame's Jacobian with the places eliminated (Schur
complement), so that time and memory grow with the frames and not with their square.
"""

from __future__ import annotations

import numpy as np

from stereocal.refined.bar_fit import (
    ALL,
    BASELINE,
    ERRORS,
    OWN,
    RESIDUALS,
    SHARED,
    descent,
    fill_motions,
    normal_matrix,
    residuals_of,
    settle,
    shared_slopes,
)
from stereocal.rig.compiled import FloatArray, compiled, internal
from stereocal.rig.decompositions import backward, factor, forward
from stereocal.rig.geometry import fill_pose, midpoint

CONVERGED = 1e-9
"""A solve ends with a step that was to lower the cost by less: 3e-5 standard errors."""
ROUGHLY = 1e-2
"""The same while the limit still comes down: a tenth of a standard error."""


@internal
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
    fill_pose(q, q[BASELINE], R, T)
    fill_motions(q, R, motions)
    slopes, J, V = np.empty((8, 4)), np.empty((ALL + 1, RESIDUALS)), np.empty((OWN, OWN))
    x, Y = np.empty(OWN), np.empty((SHARED + 1, OWN))
    for i in range(SHARED):
        g[i] = 0.0
        for j in range(SHARED):
            H[i, j] = 0.0
    cost = 0.0
    for f in range(len(pixels)):
        own = 0.0 if np.isnan(distances[f]) else length_weight
        start(R, T, rays, places, f, x)
        seen = pixels[f]
        s = settle(q, R, T, lenses, seen, distances[f], weight, own, x, slopes, J, V)
        misfits[f] = s
        rho, w = loss(s, limits[f])
        cost += rho
        if w > 0.0 and s < np.inf:
            shared_slopes(R, motions, seen, distances[f], weight, own, x, slopes, J)
            normal_matrix(J, seen, V)
            if factor(V, 0.0):
                eliminate(J, V, w, Y, H, g)
        for i in range(OWN):
            places[f, i] = x[i] if s < np.inf else np.nan
    for i in range(SHARED):
        for j in range(i):
            H[j, i] = H[i, j]
    return cost


@internal
def start(
    R: FloatArray, T: FloatArray, rays: FloatArray, places: FloatArray, f: int, x: FloatArray
) -> None:
    """Write the places of a frame; where there are none, midpoints of the targets seen.

    A target that was not seen starts 1 m in front of the camera.
    """
    known = 0.0
    for i in range(OWN):
        x[i] = places[f, i]
        known += x[i]
    if not np.isnan(known):
        return
    for target in range(2):
        at = 3 * target
        x[at], x[at + 1], x[at + 2] = 0.0, 0.0, 1.0
        if not np.isnan(rays[f, target, 0]):
            x[at], x[at + 1], x[at + 2], _, _, _ = midpoint(
                R, T, rays[f, target, 0], rays[f, target, 1], rays[f, target, 2], rays[f, target, 3]
            )


@internal
def eliminate(
    J: FloatArray, L: FloatArray, w: float, Y: FloatArray, H: FloatArray, g: FloatArray
) -> None:
    """Add w times the Schur complement of a frame to H (lower half) and g.

    With J_x J_x^T = L L^T and y = L^-1 J_x J_q^T: H = J_q J_q^T - y^T y.
    """
    for i in range(SHARED + 1):  # the unknowns, and last the residuals
        for j in range(OWN):
            Y[i, j] = descent(J, j, OWN + i)
        forward(L, Y[i])
    for i in range(SHARED + 1):
        for j in range(min(i + 1, SHARED)):
            total = 0.0
            for k in range(RESIDUALS):
                total += J[OWN + i, k] * J[OWN + j, k]
            for k in range(OWN):
                total -= Y[i, k] * Y[j, k]
            if i < SHARED:
                H[i, j] += w * total
            else:
                g[j] += w * total


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
    k, gain, cost, damping = len(p), np.inf, np.inf, 1e-5
    q, g, trial_g = np.empty(SHARED), np.empty(SHARED), np.empty(SHARED)
    trial_p, trial_places, trial_misfits = p.copy(), places.copy(), misfits.copy()
    trial_H, A, d = np.empty((SHARED, SHARED)), np.empty((k, k)), np.empty(k)
    for step in range(most_steps + 1):
        fill_shared(origin, M, trial_p, q)
        trial = sums(
            q, lenses, pixels, rays, distances, weight, length_weight, limits, trial_places,
            trial_misfits, trial_H, trial_g,
        ) + prior_cost(trial_p, precision)  # fmt: skip
        if trial <= cost or step == 0:
            cost = trial
            copy(trial_places, places)
            copy(trial_H, H)
            copy_row(trial_misfits, misfits)
            copy_row(trial_g, g)
            copy_row(trial_p, p)
            if gain < tolerance:
                return cost, step, True
            if step > 0:
                damping *= 0.05
        else:
            if gain < 1e-6:  # rounding, or the error that is left in the places
                return cost, step, True
            copy(places, trial_places)
            damping = max(20.0 * damping, 1e-4)
        normal_equations(H, g, M, p, precision, A, d)
        for i in range(k):
            A[i, i] *= 1.0 + damping
        if not factor(A, 0.0):
            return cost, step + 1, False
        forward(A, d)
        gain = 0.0
        for i in range(k):
            gain += d[i] * d[i]
        backward(A, d)
        for i in range(k):
            trial_p[i] = p[i] - d[i]
    return cost, most_steps, False


@internal
def copy(given: FloatArray, into: FloatArray) -> None:
    """Write all of a 2D array into another: an assignment of slices takes a second to compile."""
    for i in range(given.shape[0]):
        for j in range(given.shape[1]):
            into[i, j] = given[i, j]


@internal
def copy_row(given: FloatArray, into: FloatArray) -> None:
    """The same of a 1D array."""
    for i in range(len(given)):
        into[i] = given[i]


@internal
def fill_shared(origin: FloatArray, M: FloatArray, p: FloatArray, q: FloatArray) -> None:
    """q = origin + M p."""
    for i in range(SHARED):
        q[i] = origin[i]
        for j in range(len(p)):
            q[i] += M[i, j] * p[j]


@internal
def prior_cost(p: FloatArray, precision: FloatArray) -> float:
    """Sum of the squared deviations from the stated values, in standard deviations."""
    total = 0.0
    for i in range(len(p)):
        total += precision[i] * p[i] * p[i]
    return total


@internal
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
    R, T, x = np.empty((3, 3)), np.empty(3), np.empty(OWN)
    fill_pose(q, q[BASELINE], R, T)
    slopes, J, V = np.empty((8, 4)), np.empty((ALL + 1, RESIDUALS)), np.empty((OWN, OWN))
    slope = np.empty(OWN)
    for f in range(len(pixels)):
        found[f, 0] = found[f, 1] = np.nan
        for i in range(OWN):
            x[i] = places[f, i]
        seen = pixels[f]
        s = residuals_of(q, R, T, lenses, seen, distances[f], weight, 1.0, x, slopes, J)
        if not s < np.inf:  # also where there is no bar, and where there are no places
            continue
        for i in range(OWN):
            slope[i] = J[i, 8]
            J[i, 8] = 0.0
        normal_matrix(J, seen, V)
        if factor(V, 0.0):
            forward(V, slope)
            found[f, 0], found[f, 1] = J[ERRORS, 8], 0.0
            for i in range(OWN):
                found[f, 1] += slope[i] * slope[i]


@compiled
def point_slopes(
    q: FloatArray, lenses: FloatArray, weight: float, points: FloatArray, slopes: FloatArray
) -> None:
    """Write `slopes`, (n, 18, 4), of the pixels of points (n, 3): by the place and by q.

    In units of 1 / `weight` pixels. NaN behind a camera.
    """
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q, q[BASELINE], R, T)
    fill_motions(q, R, motions)
    work, J, x = np.empty((8, 4)), np.empty((ALL + 1, RESIDUALS)), np.zeros(OWN)
    pixels = np.full((2, 4), np.nan)
    for i in range(4):
        pixels[0, i] = 0.0
    for k in range(len(points)):
        for j in range(3):
            x[j] = points[k, j]
        s = residuals_of(q, R, T, lenses, pixels, 0.0, weight, 0.0, x, work, J)
        shared_slopes(R, motions, pixels, 0.0, weight, 0.0, x, work, J)
        for j in range(3 + SHARED):
            row = j if j < 3 else OWN + j - 3
            for i in range(4):
                slopes[k, j, i] = J[row, i] if s < np.inf else np.nan
