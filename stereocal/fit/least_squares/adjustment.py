"""The normal equations of all points of N cameras, compiled: a pair is the case of two.

For each q (see `views`), the 3D points are fitted unit by unit. The chi-square s(q) of a unit is
the minimum of its sum of squares. The cost is the sum of rho(s) over the units plus the priors. In
the normal equations the points are eliminated (Schur complement), so that time and memory grow
linearly with the number of units.
"""

from typing import NamedTuple

import numpy as np

from stereocal.fit.least_squares.views import (
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
from stereocal.fit.least_squares.windows import OF_WINDOW
from stereocal.rig.compiled import compiled
from stereocal.rig.decompositions import factor, forward
from stereocal.system.array_types import BoolArray, FloatArray, IntArray


@compiled
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

    The cost is the sum of s_f(q) of docs/refined.md (*What is minimised*), of each unit and under
    its `loss`; priors and measured baselines are added where this is called.

    Args:
        stated: with the stated k1, k2, p1, p2; those of q are used.
        limits: (n,): of `loss`.
        points: (n, 6), of the units, updated; NaN where first ones are needed.
        chi_squares: (n,), written.
    """
    cameras, count, unknowns = with_lenses(stated), len(stated.R), len(stated.q)
    work, index = work_of(count, len(stated.windows)), np.empty(unknowns, np.int64)
    x = np.empty(OWN)
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


@compiled
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
    cameras = unit.pixels.shape[1]
    for n in range(count):
        a = index[n]
        c, i = column_of(a, cameras)
        row = Y[a]
        if a == last:
            total = along[OWN] * by_factor
            for j in range(OWN):
                row[j] = along[j] * by_factor
        else:
            total = project(unit.pixels, work, c, i, row)
        forward(L, row)
        for j in range(OWN):
            total -= row[j] * Y[last + 1, j]
        into.g[a] += w * total
        for m in range(n + 1):
            b = index[m]
            other, k = column_of(b, cameras)
            total = 0.0
            if a == last:
                total = by_factor * by_factor if b == last else 0.0
            elif other == c:
                total = product(unit.pixels, work.Js, c, i, k)
            for j in range(OWN):
                total -= row[j] * Y[b, j]
            into.H[a, b] += w * total


@compiled
def column_of(unknown: int, cameras: int) -> tuple[int, int]:
    """The camera of an unknown, and its column of `Work.Js`."""
    of_window = unknown - EACH * cameras
    if of_window < 0:
        return unknown // EACH, unknown % EACH
    return of_window // OF_WINDOW, EACH + of_window % OF_WINDOW


@compiled
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
    for i in range(EACH * pixels.shape[1], len(free) - 1):
        c = column_of(i, pixels.shape[1])[0]
        if free[i] and not (np.isnan(pixels[0, c, 0]) and np.isnan(pixels[1, c, 0])):
            index[count] = i
            count += 1
    if unit.length_weight > 0.0 and free[len(free) - 1]:
        index[count] = len(free) - 1
        count += 1
    return count


@compiled
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


@compiled
def product(pixels: FloatArray, Js: FloatArray, c: int, i: int, j: int) -> float:
    """The product of two columns of a camera's Js."""
    total = 0.0
    for e in range(2):
        if not np.isnan(pixels[e, c, 0]):
            total += Js[e, c, 0, i] * Js[e, c, 0, j] + Js[e, c, 1, i] * Js[e, c, 1, j]
    return total


@compiled
def fill_distance(
    first: int, second: int, q: FloatArray, R: FloatArray, apart: FloatArray, J: FloatArray
) -> float:
    """Write the derivatives (12,) of the distance of two cameras by the rotation and T of each, and
    return it.

    Args:
        apart: (3,), for work.
    """
    apart[:] = 0.0
    for c, sign in ((first, -1.0), (second, 1.0)):
        T = q[EACH * c + TRANSLATION : EACH * c + LENS]
        for i in range(3):  # centre = -R^T T
            apart[i] += sign * (R[c, 0, i] * T[0] + R[c, 1, i] * T[1] + R[c, 2, i] * T[2])
    length = np.sqrt(apart[0] ** 2 + apart[1] ** 2 + apart[2] ** 2)
    for k, c, sign in ((0, first, -1.0), (1, second, 1.0)):
        by_turn, by_T = J[LENS * k : LENS * k + 3], J[LENS * k + 3 : LENS * k + 6]
        T, scale = q[EACH * c + TRANSLATION : EACH * c + LENS], sign / length
        for i in range(3):
            by_T[i] = scale * (
                R[c, i, 0] * apart[0] + R[c, i, 1] * apart[1] + R[c, i, 2] * apart[2]
            )
        for i in range(3):  # turning the camera by w moves its centre by R^T (w x T)
            j, m = (i + 1) % 3, (i + 2) % 3
            by_turn[i] = by_T[j] * T[m] - by_T[m] * T[j]
    return float(length)


@compiled
def add_baselines(
    baselines: FloatArray, q: FloatArray, R: FloatArray, H: FloatArray, g: FloatArray
) -> float:
    """Add the normal equations of measured baselines to H (V, V) and g (V,); return their cost.

    Args:
        baselines: (m, 4): the numbers of two cameras, their distance and its standard deviation.
    """
    cost, J, apart = 0.0, np.empty(2 * LENS), np.empty(3)
    for n in range(len(baselines)):
        both = int(baselines[n, 0]), int(baselines[n, 1])
        sigma = baselines[n, 3]
        error = (fill_distance(both[0], both[1], q, R, apart, J) - baselines[n, 2]) / sigma
        cost += error * error
        for a in range(2 * LENS):
            row = EACH * both[a // LENS] + a % LENS
            g[row] += J[a] * error / sigma
            for b in range(2 * LENS):
                H[row, EACH * both[b // LENS] + b % LENS] += J[a] * J[b] / sigma**2
    return cost


@compiled
def length_innovations(
    stated: Cameras, units: Units, points: FloatArray, innovations: FloatArray
) -> None:
    """Write the length of each unit as the pixels alone determine it, to `innovations` (n, 2).

    Column 0: the distance between `points`, which must be fitted to the pixels alone, minus the
    stated length, in metres. Column 1: its variance from the noise of the pixels, in square metres:
    l^T (J_x J_x^T)^-1 l, where l is the gradient of the length. NaN without a known length.
    """
    cameras, count = with_lenses(stated), len(stated.R)
    work, gradient, still = work_of(count), np.empty(OWN), np.empty((0, count, 3))
    for n in range(len(units.pixels)):
        innovations[n, 0] = innovations[n, 1] = np.nan
        if np.isnan(units.distances[n]) or np.isnan(points[n, 0]):
            continue
        unit = Unit(units.pixels[n], still, units.distances[n], units.weight, 1.0)
        if not fill_residuals(cameras, cameras.windows, unit, points[n], work) < np.inf:
            continue
        for i in range(OWN):
            gradient[i] = work.along[i]
        fill_normal_matrix(unit, 0.0, work)
        if factor(work.V, 0.0):
            forward(work.V, gradient)
            innovations[n, 0], innovations[n, 1] = work.along[OWN], 0.0
            for i in range(OWN):
                innovations[n, 1] += gradient[i] * gradient[i]
