"""The least squares over all points of N cameras, compiled: a pair is the case of two.

For each q (see `views`), the 3D points are fitted unit by unit. The chi-square s(q) of a unit is
the minimum of its sum of squares. The cost is the sum of rho(s) over the units plus the priors. In
the normal equations the points are eliminated (Schur complement), so that time and memory grow
linearly with the number of units.
"""

from typing import NamedTuple

import numpy as np

from stereocal.refined.two_views import SHARED, fill_views
from stereocal.refined.views import (
    DISTORTION,
    EACH,
    LENS,
    OWN,
    TRANSLATION,
    Cameras,
    Unit,
    Units,
    Work,
    fill_gradient,
    fill_normal_matrix,
    fill_residuals,
    fill_shared,
    fit_unit,
    start_unit,
    with_lenses,
    work_of,
)
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray, compiled, internal
from stereocal.rig.decompositions import backward, factor, forward

TOLERANCE = 1e-9
"""A solve ends when a step is predicted to lower the cost by less: 3e-5 standard errors."""
ROUGH_TOLERANCE = 1e-2
"""The same while the limit is still being lowered: a tenth of a standard error."""


@internal
def loss(s: float, limit: float) -> tuple[float, float]:
    """Tukey's biweight rho(s) of a chi-square s, and its derivative, the unit's weight.

    rho is s near 0 and constant above `limit`, where the weight is 0. An infinite limit gives plain
    least squares, a limit of 0 leaves the unit out.
    """
    if limit == np.inf:
        return s, 1.0
    if not s < limit:
        return limit / 3.0, 0.0
    left = 1.0 - s / limit
    return limit / 3.0 * (1.0 - left * left * left), left * left


class Equations(NamedTuple):
    """Normal equations without the points, H (Q, Q) and g = J r (Q,): 0 where not `free` (Q,)."""

    free: BoolArray
    H: FloatArray
    g: FloatArray


def equations_for(free: BoolArray) -> Equations:
    """Room for those of as many unknowns."""
    size = len(free)
    return Equations(free, np.empty((size, size)), np.empty(size))


class State(NamedTuple):
    """What a step changes: p (k,), R (c, 3, 3), the units' points (n, 6), NaN where first ones are
    needed, and their chi-squares (n,)."""

    p: FloatArray
    R: FloatArray
    points: FloatArray
    chi_squares: FloatArray


@compiled
def sum_normal_equations(
    stated: Cameras,
    units: Units,
    limits: FloatArray,
    points: FloatArray,
    chi_squares: FloatArray,
    into: Equations,
) -> float:
    """Fit the points of all units, sum the normal equations, and return the cost.

    Args:
        stated: with the stated k1, k2, p1, p2; those of q are used.
        limits: (n,): of `loss`.
        points: (n, 6), updated, and chi_squares: (n,), written: see `State`.
    """
    cameras, count, unknowns = with_lenses(stated), len(stated.R), len(stated.q)
    work, index, x = work_of(count), np.empty(unknowns, np.int64), np.empty(OWN)
    Y = np.empty((unknowns + 1, OWN))
    still, distorted, cost = np.empty((0, count, 3)), False, 0.0
    for i in range(unknowns):
        place = i % EACH - DISTORTION
        distorted = distorted or (into.free[i] and i < EACH * count and 0 <= place < 4)
        into.g[i] = 0.0
        for j in range(unknowns):
            into.H[i, j] = 0.0
    for n in range(len(units.pixels)):
        moving, distance = units.motion[n] if len(units.motion) else still, units.distances[n]
        known = 0.0 if np.isnan(distance) else units.length_weight
        unit = Unit(units.pixels[n], moving, distance, units.weight, known)
        for i in range(OWN):
            x[i] = points[n, i]
        start_unit(cameras, units.rays[n], x, work.small)
        s = fit_unit(cameras, unit, x, work)
        chi_squares[n] = s
        rho, w = loss(s, limits[n])
        cost += rho
        if w > 0.0 and s < np.inf:
            fill_shared(cameras, unit, x, distorted, work)
            fill_normal_matrix(unit, known, work)
            if factor(work.V, 0.0):
                eliminate(stated.q, unit, work, w, index, Y, into)
        for i in range(OWN):
            points[n, i] = x[i] if s < np.inf else np.nan
    for i in range(unknowns):
        for j in range(i):
            into.H[j, i] = into.H[i, j]
    return cost


@internal
def eliminate(
    q: FloatArray, unit: Unit, work: Work, w: float, index: IntArray, Y: FloatArray, into: Equations
) -> None:
    """Add w times the Schur complement of a unit to H (lower half) and g.

    With J_x J_x^T = L L^T and y = L^-1 J_x J_q^T: H = J_q J_q^T - y^T y.

    Args:
        work: with Cholesky's factor in V.
        index: (Q,), Y: (Q + 1, 6), for work.
    """
    last, along, L = len(q) - 1, work.along, work.V
    count = active_unknowns(unit, into.free, index)
    by_factor = -(along[OWN] + unit.length_weight * unit.distance) / q[last]
    fill_gradient(unit, work, Y[last + 1])
    forward(L, Y[last + 1])
    for n in range(count):
        a = index[n]
        c = a // EACH
        row = Y[a]
        if a == last:
            total = along[OWN] * by_factor
            for j in range(OWN):
                row[j] = along[j] * by_factor
        else:
            total = project(unit.pixels, work, c, a - EACH * c, row)
        forward(L, row)
        for j in range(OWN):
            total -= row[j] * Y[last + 1, j]
        into.g[a] += w * total
        for m in range(n + 1):
            b = index[m]
            total = 0.0
            if a == last:
                total = by_factor * by_factor if b == last else 0.0
            elif b // EACH == c:
                total = product(unit.pixels, work.Js, c, a - EACH * c, b - EACH * c)
            for j in range(OWN):
                total -= row[j] * Y[b, j]
            into.H[a, b] += w * total


@internal
def active_unknowns(unit: Unit, free: BoolArray, index: IntArray) -> int:
    """Write the unknowns that a unit depends on to `index`, ascending, and return their number."""
    count, pixels = 0, unit.pixels
    for c in range(pixels.shape[1]):
        if np.isnan(pixels[0, c, 0]) and np.isnan(pixels[1, c, 0]):
            continue
        for i in range(EACH):
            if free[EACH * c + i]:
                index[count] = EACH * c + i
                count += 1
    if unit.length_weight > 0.0 and free[len(free) - 1]:
        index[count] = len(free) - 1
        count += 1
    return count


@internal
def project(pixels: FloatArray, work: Work, c: int, i: int, row: FloatArray) -> float:
    """Write Jx^T times an unknown's column of Js to `row` (6,); return the column times r."""
    total, r, Jx, Js = 0.0, work.r, work.Jx, work.Js
    row[:] = 0.0
    for e in range(2):
        if not np.isnan(pixels[e, c, 0]):
            for k in range(2):
                s = Js[e, c, k, i]
                total += s * r[e, c, k]
                for j in range(3):
                    row[3 * e + j] += s * Jx[e, c, k, j]
    return total


@internal
def product(pixels: FloatArray, Js: FloatArray, c: int, i: int, j: int) -> float:
    """The product of two columns of a camera's Js."""
    total = 0.0
    for e in range(2):
        if not np.isnan(pixels[e, c, 0]):
            total += Js[e, c, 0, i] * Js[e, c, 0, j] + Js[e, c, 1, i] * Js[e, c, 1, j]
    return total


class Parameters(NamedTuple):
    """Free parameters p of the unknowns of `views`, or of a pair's shared ones: origin (Q,) + M p.

    Args:
        by_parameter: (k, Q): the transpose of M.
        precision: (k, k): of the prior of p, normal with mean 0; 0 for no prior.
        rotations: (k,): which of p are small ones: they are 0 after each step.
    """

    origin: FloatArray
    by_parameter: FloatArray
    precision: FloatArray
    rotations: BoolArray


@compiled
def adjust(
    parameters: Parameters,
    state: State,
    lenses: FloatArray,
    units: Units,
    baselines: FloatArray,
    limits: FloatArray,
    into: Equations,
    tolerance: float,
    most_steps: int,
) -> tuple[float, int, bool]:
    """Minimise the cost over the free parameters p (Levenberg-Marquardt).

    Args:
        state: updated, as is H (of `views`) of the equations found.
        lenses: (c, 23): as of `Cameras`, with the stated k1, k2, p1, p2.
        baselines: as in `add_baselines`; they are not in H.

    Returns:
        The cost with the priors, the number of steps tried, and whether it converged.
    """
    k, size, gain, cost, damping = len(state.p), len(into.H), np.inf, np.inf, 1e-5
    q, by_p, precision = np.empty(size), np.empty((k, size)), parameters.precision
    trial = State(state.p.copy(), state.R.copy(), state.points.copy(), state.chi_squares.copy())
    tried, with_baselines = Equations(into.free, into.H.copy(), into.g), into.H.copy()
    A, damped, b, d = np.empty((k, k)), np.empty((k, k)), np.empty(k), np.empty(k)
    for step in range(most_steps + 1):
        place(parameters, trial, state.R, q, by_p)
        total = sum_normal_equations(
            Cameras(q, trial.R, lenses), units, limits, trial.points, trial.chi_squares, tried
        ) + prior_cost(trial.p, precision)
        copy(tried.H, with_baselines)
        total += add_baselines(baselines, q, trial.R, with_baselines, tried.g)
        if total <= cost or step == 0:
            cost = total
            copy(trial.points, state.points)
            copy(tried.H, into.H)
            copy_row(trial.chi_squares, state.chi_squares)
            copy_row(trial.p, state.p)
            for c in range(len(state.R)):
                copy(trial.R[c], state.R[c])
            if gain < tolerance:
                return cost, step, True
            if step > 0:
                damping *= 0.05
            reduce_normal_equations(with_baselines, tried.g, by_p, state.p, precision, A, b)
        else:
            if gain < 1e-6:  # rounding, or the remaining error of the points
                return cost, step, True
            copy(state.points, trial.points)
            damping = max(20.0 * damping, 1e-4)
        gain = damped_step(A, b, damping, damped, d)
        if gain < 0.0:
            return cost, step + 1, False
        for i in range(k):
            trial.p[i] = state.p[i] - d[i]
    return cost, most_steps, False


@internal
def damped_step(
    A: FloatArray, b: FloatArray, damping: float, work: FloatArray, d: FloatArray
) -> float:
    """Write the step d (k,) of Levenberg and Marquardt, and return the predicted decrease.

    It is -1 if A is not positive definite.
    """
    copy(A, work)
    copy_row(b, d)
    for i in range(len(d)):
        work[i, i] *= 1.0 + damping
    if not factor(work, 0.0):
        return -1.0
    forward(work, d)
    gain = 0.0
    for i in range(len(d)):
        gain += d[i] * d[i]
    backward(work, d)
    return gain


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
def multiply(A: FloatArray, B: FloatArray, C: FloatArray) -> None:
    """C = A B, for an A with many zeros."""
    for i in range(A.shape[0]):
        for j in range(B.shape[1]):
            C[i, j] = 0.0
        for k in range(A.shape[1]):
            if A[i, k] != 0.0:
                for j in range(B.shape[1]):
                    C[i, j] += A[i, k] * B[k, j]


@internal
def place(
    parameters: Parameters, state: State, before: FloatArray, q: FloatArray, by_p: FloatArray
) -> None:
    """Write the unknowns q (V,) of `views`, the state's rotations, and the derivatives (k, V) by p.

    Args:
        before: (c, 3, 3): the rotations before the small ones of p, which become 0.
    """
    by_parameter, p, R = parameters.by_parameter, state.p, state.R
    shared = parameters.origin.copy()
    for j in range(len(p)):
        for i in range(len(shared)):
            shared[i] += p[j] * by_parameter[j, i]
    if len(shared) == SHARED:
        by_shared = np.empty((SHARED, len(q)))
        fill_views(shared, q, R, by_shared)
        multiply(by_parameter, by_shared, by_p)
        return
    copy(by_parameter, by_p)
    copy_row(shared, q)
    for c in range(len(R)):
        turn(shared[EACH * c : EACH * c + TRANSLATION], before[c], R[c])
        for i in range(TRANSLATION):
            q[EACH * c + i] = 0.0
    for j in range(len(p)):
        p[j] = 0.0 if parameters.rotations[j] else p[j]


@internal
def turn(w: FloatArray, before: FloatArray, R: FloatArray) -> None:
    """R = exp(w) before (Rodrigues)."""
    square = w[0] * w[0] + w[1] * w[1] + w[2] * w[2]
    angle = np.sqrt(square)
    sine = np.sin(angle) / angle if square > 1e-16 else 1.0
    versine = (1.0 - np.cos(angle)) / square if square > 1e-16 else 0.5
    for j in range(3):
        a, b, c = before[0, j], before[1, j], before[2, j]
        along = versine * (w[0] * a + w[1] * b + w[2] * c)
        rest = 1.0 - versine * square
        R[0, j] = rest * a + sine * (w[1] * c - w[2] * b) + along * w[0]
        R[1, j] = rest * b + sine * (w[2] * a - w[0] * c) + along * w[1]
        R[2, j] = rest * c + sine * (w[0] * b - w[1] * a) + along * w[2]


@compiled
def add_baselines(
    baselines: FloatArray, q: FloatArray, R: FloatArray, H: FloatArray, g: FloatArray
) -> float:
    """Add the normal equations of measured baselines to H (V, V) and g (V,); return their cost.

    Args:
        baselines: (m, 4): the numbers of two cameras, their distance and its standard deviation.
    """
    cost, J, place = 0.0, np.empty(12), np.empty(12, np.int64)
    for m in range(len(baselines)):
        error = fill_baseline(baselines[m], q, R, J, place)
        cost += error * error
        for i in range(12):
            g[place[i]] += J[i] * error
            for j in range(12):
                H[place[i], place[j]] += J[i] * J[j]
    return cost


@internal
def fill_baseline(
    baseline: FloatArray, q: FloatArray, R: FloatArray, J: FloatArray, place: IntArray
) -> float:
    """Return the error of a baseline; write its derivatives (12,) and the places of both poses."""
    apart = np.zeros(3)
    for end in range(2):
        c = int(baseline[end])
        for i in range(3):  # centre = -R^T T
            for j in range(3):
                apart[j] += (2 * end - 1) * R[c, i, j] * q[EACH * c + TRANSLATION + i]
    length = np.sqrt(apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2)
    for end in range(2):
        c, k = int(baseline[end]), 6 * end
        T, by_T = q[EACH * c + TRANSLATION : EACH * c + LENS], J[k + 3 : k + 6]
        for i in range(3):
            along = R[c, i, 0] * apart[0] + R[c, i, 1] * apart[1] + R[c, i, 2] * apart[2]
            by_T[i] = (2 * end - 1) * along / (length * baseline[3])
        # turning the camera by w moves its centre by R^T (w x T)
        J[k] = T[2] * by_T[1] - T[1] * by_T[2]
        J[k + 1] = T[0] * by_T[2] - T[2] * by_T[0]
        J[k + 2] = T[1] * by_T[0] - T[0] * by_T[1]
        for i in range(6):
            place[k + i] = EACH * c + i
    return float((length - baseline[2]) / baseline[3])


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
    by_p: FloatArray,
    p: FloatArray,
    precision: FloatArray,
    A: FloatArray,
    b: FloatArray,
) -> None:
    """A = D H D^T + precision, b = D g + precision p, with D the derivatives (k, V) by p."""
    DH = np.empty(by_p.shape)
    multiply(by_p, H, DH)
    for i in range(len(p)):
        b[i] = 0.0
        for r in range(len(g)):
            b[i] += by_p[i, r] * g[r]
        for j in range(len(p)):
            b[i] += precision[i, j] * p[j]
            A[i, j] = precision[i, j]
            for r in range(len(g)):
                A[i, j] += DH[i, r] * by_p[j, r]


@compiled
def length_innovations(
    stated: Cameras, units: Units, points: FloatArray, found: FloatArray
) -> None:
    """Write the length of each unit as the pixels alone determine it, to `found` (n, 2).

    Column 0: the distance between `points`, which must be fitted to the pixels alone, minus the
    stated length, in metres. Column 1: its variance from the noise of the pixels, in square metres:
    l^T (J_x J_x^T)^-1 l, where l is the gradient of the length. NaN without a known length.
    """
    cameras, count = with_lenses(stated), len(stated.R)
    work, gradient, still = work_of(count), np.empty(OWN), np.empty((0, count, 3))
    for n in range(len(units.pixels)):
        found[n, 0] = found[n, 1] = np.nan
        if np.isnan(units.distances[n]) or np.isnan(points[n, 0]):
            continue
        unit = Unit(units.pixels[n], still, units.distances[n], units.weight, 1.0)
        if not fill_residuals(cameras, unit, points[n], work) < np.inf:
            continue
        for i in range(OWN):
            gradient[i] = work.along[i]
        fill_normal_matrix(unit, 0.0, work)
        if factor(work.V, 0.0):
            forward(work.V, gradient)
            found[n, 0], found[n, 1] = work.along[OWN], 0.0
            for i in range(OWN):
                found[n, 1] += gradient[i] * gradient[i]
