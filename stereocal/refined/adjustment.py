"""The refined method's least squares over all frames, compiled.

For each q (see `bar_fit`), the 3D points are fitted frame by frame. The chi-square of a frame,
s(q), is the minimum of its sum of squares. The cost is the sum of rho(s) over the frames plus the
priors. In the normal equations the points are eliminated (Schur complement), so that time and
memory grow linearly with the number of frames.
"""

from __future__ import annotations

import numpy as np

from stereocal.refined.bar_fit import (
    ALL,
    BASELINE,
    DISTORTION,
    ERRORS,
    OWN,
    RESIDUALS,
    SHARED,
    fill_motions,
    fill_residuals,
    fill_shared_derivatives,
    fit_points,
    normal_matrix,
    row_product,
)
from stereocal.refined.distortion import set_distortion
from stereocal.rig.compiled import FloatArray, IntArray, compiled, internal
from stereocal.rig.decompositions import backward, factor, forward
from stereocal.rig.geometry import fill_pose, midpoint

TOLERANCE = 1e-9
"""A solve ends when a step is predicted to lower the cost by less: 3e-5 standard errors."""
ROUGH_TOLERANCE = 1e-2
"""The same while the limit is still being lowered: a tenth of a standard error."""
LARGEST_LOG_RATIO, BISECTIONS = 20.7, 24
"""Range of the logarithm of a variance, a factor of 1e9, and halvings of it: to 1e-6."""


@internal
def loss(s: float, limit: float) -> tuple[float, float]:
    """Tukey's biweight rho(s) of a chi-square s, and its derivative, the frame's weight.

    rho is s near 0 and constant above `limit`, where the weight is 0. An infinite limit gives plain
    least squares, a limit of 0 leaves the frame out.
    """
    if limit == np.inf:
        return s, 1.0
    if not s < limit:
        return limit / 3.0, 0.0
    left = 1.0 - s / limit
    return limit / 3.0 * (1.0 - left * left * left), left * left


@compiled
def sum_normal_equations(
    q: FloatArray,
    free: IntArray,
    stated_lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    distances: FloatArray,
    weight: float,
    length_weight: float,
    limits: FloatArray,
    points: FloatArray,
    chi_squares: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> float:
    """Fit the points of all frames, sum the normal equations, and return the cost.

    Args:
        free: the indices of the unknowns that are not held fixed; H and g are 0 for the others.
        stated_lenses: (2, 23): as `lenses` in `bar_fit.fill_residuals`; the k1, k2, p1, p2 are
            those of q.
        pixels: (n, 2, 4): as in `bar_fit.fill_residuals`.
        rays: (n, 2, 4): the same points undistorted with the stated lenses, for initial points.
        distances: (n,): in metres; NaN without a bar.
        points: (n, 6), updated: 3D points; NaN where initial points are needed.
        chi_squares: (n,), written.
        H: (25, 25), written: J J^T with x eliminated.
        g: (25,), written: J r with x eliminated.
    """
    lenses = set_distortion(q, DISTORTION, stated_lenses)
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q, q[BASELINE], R, T)
    fill_motions(q, R, motions)
    derivatives, J, V = np.empty((8, 5)), np.empty((ALL + 1, RESIDUALS)), np.empty((OWN, OWN))
    x, Y = np.empty(OWN), np.empty((SHARED + 1, OWN))
    for i in range(SHARED):
        g[i] = 0.0
        for j in range(SHARED):
            H[i, j] = 0.0
    cost = 0.0
    bent = len(free) > 0 and free[-1] >= DISTORTION
    for f in range(len(pixels)):
        own = 0.0 if np.isnan(distances[f]) else length_weight
        start_points(R, T, rays, points, f, x)
        seen = pixels[f]
        s = fit_points(q, R, T, lenses, seen, distances[f], weight, own, x, derivatives, J, V)
        chi_squares[f] = s
        rho, w = loss(s, limits[f])
        cost += rho
        if w > 0.0 and s < np.inf:
            fill_shared_derivatives(
                q, R, motions, lenses, bent, seen, distances[f], weight, own, x, derivatives, J
            )
            normal_matrix(J, seen, V)
            if factor(V, 0.0):
                eliminate(J, V, w, free, Y, H, g)
        for i in range(OWN):
            points[f, i] = x[i] if s < np.inf else np.nan
    for i in range(SHARED):
        for j in range(i):
            H[j, i] = H[i, j]
    return cost


@internal
def start_points(
    R: FloatArray, T: FloatArray, rays: FloatArray, points: FloatArray, f: int, x: FloatArray
) -> None:
    """Write the initial points of a frame to x: `points[f]`, or midpoints if these are NaN.

    A target that was not seen is put 1 m in front of the camera.
    """
    known = 0.0
    for i in range(OWN):
        x[i] = points[f, i]
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
    J: FloatArray,
    L: FloatArray,
    w: float,
    free: IntArray,
    Y: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> None:
    """Add w times the Schur complement of a frame to H (lower half) and g.

    With J_x J_x^T = L L^T and y = L^-1 J_x J_q^T: H = J_q J_q^T - y^T y.
    """
    n = len(free)
    for a in range(n + 1):  # the unknowns, and last the residuals
        i = free[a] if a < n else SHARED
        for j in range(OWN):
            Y[i, j] = row_product(J, j, OWN + i)
        forward(L, Y[i])
        for b in range(min(a + 1, n)):
            j = free[b]
            total = 0.0
            for k in range(RESIDUALS):
                total += J[OWN + i, k] * J[OWN + j, k]
            for k in range(OWN):
                total -= Y[i, k] * Y[j, k]
            if a < n:
                H[i, j] += w * total
            else:
                g[j] += w * total


@compiled
def adjust(
    origin: FloatArray,
    M: FloatArray,
    free: IntArray,
    precision: FloatArray,
    p: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    distances: FloatArray,
    weight: float,
    length_weight: float,
    limits: FloatArray,
    points: FloatArray,
    chi_squares: FloatArray,
    H: FloatArray,
    tolerance: float,
    most_steps: int,
) -> tuple[float, int, bool]:
    """Minimise the cost over the free parameters p (Levenberg-Marquardt), with q = origin + M p.

    p, points, chi_squares and H are updated in place. The prior of p is normal with mean 0 and the
    given precision (k, k), 0 for no prior.

    Returns:
        The cost with the priors, the number of steps tried, and whether it converged.
    """
    k, gain, cost, damping = len(p), np.inf, np.inf, 1e-5
    q, g, trial_g = np.empty(SHARED), np.empty(SHARED), np.empty(SHARED)
    trial_p, trial_points, trial_chi_squares = p.copy(), points.copy(), chi_squares.copy()
    trial_H, A, d = np.empty((SHARED, SHARED)), np.empty((k, k)), np.empty(k)
    for step in range(most_steps + 1):
        fill_shared(origin, M, trial_p, q)
        trial = sum_normal_equations(
            q,
            free,
            lenses,
            pixels,
            rays,
            distances,
            weight,
            length_weight,
            limits,
            trial_points,
            trial_chi_squares,
            trial_H,
            trial_g,
        ) + prior_cost(trial_p, precision)
        if trial <= cost or step == 0:
            cost = trial
            copy(trial_points, points)
            copy(trial_H, H)
            copy_row(trial_chi_squares, chi_squares)
            copy_row(trial_g, g)
            copy_row(trial_p, p)
            if gain < tolerance:
                return cost, step, True
            if step > 0:
                damping *= 0.05
        else:
            if gain < 1e-6:  # rounding, or the remaining error of the points
                return cost, step, True
            copy(points, trial_points)
            damping = max(20.0 * damping, 1e-4)
        reduce_normal_equations(H, g, M, free, p, precision, A, d)
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
    """Copy a 2D array into another. An assignment of slices would take a second to compile."""
    for i in range(given.shape[0]):
        for j in range(given.shape[1]):
            into[i, j] = given[i, j]


@internal
def copy_row(given: FloatArray, into: FloatArray) -> None:
    """Copy a 1D array into another."""
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
    """p^T precision p."""
    total = 0.0
    for i in range(len(p)):
        for j in range(len(p)):
            total += p[i] * precision[i, j] * p[j]
    return total


@internal
def reduce_normal_equations(
    H: FloatArray,
    g: FloatArray,
    M: FloatArray,
    free: IntArray,
    p: FloatArray,
    precision: FloatArray,
    A: FloatArray,
    b: FloatArray,
) -> None:
    """A = M^T H M + precision, b = M^T g + precision p."""
    for i in range(len(p)):
        b[i] = 0.0
        for r in free:
            b[i] += M[r, i] * g[r]
        for j in range(len(p)):
            b[i] += precision[i, j] * p[j]
            total = precision[i, j]
            for r in free:
                if M[r, i] != 0.0:
                    for s in free:
                        total += M[r, i] * H[r, s] * M[s, j]
            A[i, j] = total


@compiled
def length_innovations(
    q: FloatArray,
    stated_lenses: FloatArray,
    pixels: FloatArray,
    distances: FloatArray,
    weight: float,
    points: FloatArray,
    found: FloatArray,
) -> None:
    """Write the length of each bar as the pixels alone determine it, to `found` (n, 2).

    Column 0: the distance between `points`, which must be fitted to the pixels alone, minus the
    stated length, in metres. Column 1: its variance from the noise of the pixels, in square metres:
    l^T (J_x J_x^T)^-1 l, where l is the gradient of the length. NaN if there is no bar.
    """
    lenses = set_distortion(q, DISTORTION, stated_lenses)
    R, T, x = np.empty((3, 3)), np.empty(3), np.empty(OWN)
    fill_pose(q, q[BASELINE], R, T)
    derivatives, J, V = np.empty((8, 5)), np.empty((ALL + 1, RESIDUALS)), np.empty((OWN, OWN))
    gradient = np.empty(OWN)
    for f in range(len(pixels)):
        found[f, 0] = found[f, 1] = np.nan
        for i in range(OWN):
            x[i] = points[f, i]
        seen = pixels[f]
        s = fill_residuals(q, R, T, lenses, seen, distances[f], weight, 1.0, x, derivatives, J)
        if not s < np.inf:  # NaN without a bar or without points
            continue
        for i in range(OWN):
            gradient[i] = J[i, 8]
            J[i, 8] = 0.0
        normal_matrix(J, seen, V)
        if factor(V, 0.0):
            forward(V, gradient)
            found[f, 0], found[f, 1] = J[ERRORS, 8], 0.0
            for i in range(OWN):
                found[f, 1] += gradient[i] * gradient[i]


@compiled
def excess_variance(squares: FloatArray, variances: FloatArray, left: float, third: float) -> float:
    """The variance c for which sum(squares / (c + variances)) is `left`, by bisection of its log.

    Args:
        third: if not 0, c is that for which the lower third of the terms is this.
    """
    high = np.log(10.0 * len(squares) * squares.max())
    low = high - LARGEST_LOG_RATIO
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        terms = squares / (np.exp(middle) + variances)
        if third > 0.0:
            too_small = np.sort(terms)[(len(terms) - 1) // 3] > third
        else:
            too_small = terms.sum() > left
        if too_small:
            low = middle
        else:
            high = middle
    return float(np.exp(0.5 * (low + high)))


@compiled
def fill_point_jacobians(
    q: FloatArray,
    stated_lenses: FloatArray,
    weight: float,
    points: FloatArray,
    derivatives: FloatArray,
) -> None:
    """Write the derivatives of the pixels of points (n, 3), by the point and by q.

    Args:
        weight: 1 / sigma_px, by which the derivatives are multiplied.
        derivatives: (n, 28, 4), written; NaN behind a camera.
    """
    lenses = set_distortion(q, DISTORTION, stated_lenses)
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q, q[BASELINE], R, T)
    fill_motions(q, R, motions)
    work, J, x = np.empty((8, 5)), np.empty((ALL + 1, RESIDUALS)), np.zeros(OWN)
    pixels = np.full((2, 4), np.nan)
    for i in range(4):
        pixels[0, i] = 0.0
    for k in range(len(points)):
        for j in range(3):
            x[j] = points[k, j]
        s = fill_residuals(q, R, T, lenses, pixels, 0.0, weight, 0.0, x, work, J)
        fill_shared_derivatives(q, R, motions, lenses, True, pixels, 0.0, weight, 0.0, x, work, J)
        for j in range(3 + SHARED):
            row = j if j < 3 else OWN + j - 3
            for i in range(4):
                derivatives[k, j, i] = J[row, i] if s < np.inf else np.nan
