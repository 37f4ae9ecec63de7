"""Residuals of points seen by N cameras, and their normal equations, compiled.

The unknowns `q` are, camera by camera, 15 values: a small rotation of the camera about its own axes
(x_camera = exp(w) R x + T), T in metres, fx, fy, cx, cy, k1, k2, p1, p2, and by how many frames the
camera is late; after those of all cameras the factor of the object's lengths. R is kept apart, and
w is 0 after each step.

Points come in units of two: the ends of a known length, or one point and nothing. Given q, units
are independent, so that each is fitted and eliminated by itself. The residuals are those of the
pair's adjustment (`refined.bar_fit`): pixels over sigma_px, and the length over the factor minus
the stated one, over its scatter.
"""

from __future__ import annotations

import numpy as np

from stereocal.refined.adjustment import loss
from stereocal.refined.distortion import distort, distortion_derivatives
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray, compiled, internal
from stereocal.rig.decompositions import backward, factor, forward

EACH = 15
TRANSLATION, LENS, DISTORTION, TIME = 3, 6, 10, 14
OWN = 6
MAXIMUM_STEPS = 15
TOLERANCE = 1e-7
"""As `bar_fit.TOLERANCE`: relative reduction of a unit's sum of squares."""


@internal
def fill_residuals(
    q: FloatArray,
    R: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    motion: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    r: FloatArray,
    Jx: FloatArray,
    along: FloatArray,
) -> float:
    """Write the residuals of a unit and their derivatives by its points; return their squares' sum.

    Args:
        R: (c, 3, 3).
        lenses: (c, 23), as in `bar_fit.fill_residuals`, with the k1, k2, p1, p2 of q.
        pixels: (2, c, 2); NaN where a camera does not see a point.
        motion: (2, c, 2): velocities in pixels per frame; empty if the times are known.
        x: (6,): both points in the reference's frame.
        r: (2, c, 2) and Jx (2, c, 2, 3), written where there are pixels.
        along: (7,), written: the derivatives of the length's residual by x, and the residual.
    """
    total = 0.0
    for e in range(2):
        for c in range(len(R)):
            if np.isnan(pixels[e, c, 0]):
                continue
            at, p = EACH * c, 3 * e
            X = R[c, 0, 0] * x[p] + R[c, 0, 1] * x[p + 1] + R[c, 0, 2] * x[p + 2] + q[at + 3]
            Y = R[c, 1, 0] * x[p] + R[c, 1, 1] * x[p + 1] + R[c, 1, 2] * x[p + 2] + q[at + 4]
            Z = R[c, 2, 0] * x[p] + R[c, 2, 1] * x[p + 1] + R[c, 2, 2] * x[p + 2] + q[at + 5]
            if not Z > 0.0:
                return np.inf
            near, fx, fy, skew = 1.0 / Z, q[at + LENS], q[at + LENS + 1], lenses[c, 0]
            nx, ny = X * near, Y * near
            bx, by, xx, xy, yx, yy = distort(nx, ny, lenses, c)
            u, v = pixels[e, c, 0], pixels[e, c, 1]
            if len(motion):
                u -= q[at + TIME] * motion[e, c, 0]
                v -= q[at + TIME] * motion[e, c, 1]
            r[e, c, 0] = weight * (fx * bx + skew * by + q[at + LENS + 2] - u)
            r[e, c, 1] = weight * (fy * by + q[at + LENS + 3] - v)
            total += r[e, c, 0] ** 2 + r[e, c, 1] ** 2
            scale = weight * near
            ux, uy = scale * (fx * xx + skew * yx), scale * (fx * xy + skew * yy)
            vx, vy = scale * fy * yx, scale * fy * yy
            uz, vz = -(ux * nx + uy * ny), -(vx * nx + vy * ny)
            for j in range(3):
                Jx[e, c, 0, j] = ux * R[c, 0, j] + uy * R[c, 1, j] + uz * R[c, 2, j]
                Jx[e, c, 1, j] = vx * R[c, 0, j] + vy * R[c, 1, j] + vz * R[c, 2, j]
    if length_weight > 0.0:
        factor_of_length, square = q[len(q) - 1], 0.0
        for j in range(3):
            square += (x[j] - x[j + 3]) ** 2
        length = np.sqrt(square)
        along[OWN] = length_weight * (length / factor_of_length - distance)
        for j in range(3):
            along[j] = length_weight / (factor_of_length * length) * (x[j] - x[j + 3])
            along[j + 3] = -along[j]
        total += along[OWN] ** 2
    return total


@internal
def fill_normal_matrix(
    pixels: FloatArray, Jx: FloatArray, along: FloatArray, length_weight: float, V: FloatArray
) -> None:
    """Write the lower half of the normal matrix (6, 6) of a unit's points; 1 for one not seen."""
    for i in range(OWN):
        for j in range(i + 1):
            V[i, j] = along[i] * along[j] if length_weight > 0.0 else 0.0
    for e in range(2):
        seen = False
        for c in range(pixels.shape[1]):
            if np.isnan(pixels[e, c, 0]):
                continue
            seen = True
            for i in range(3):
                for j in range(i + 1):
                    V[3 * e + i, 3 * e + j] += (
                        Jx[e, c, 0, i] * Jx[e, c, 0, j] + Jx[e, c, 1, i] * Jx[e, c, 1, j]
                    )
        if not seen:
            for i in range(3):
                V[3 * e + i, 3 * e + i] = 1.0


@internal
def fill_gradient(
    pixels: FloatArray,
    r: FloatArray,
    Jx: FloatArray,
    along: FloatArray,
    length_weight: float,
    b: FloatArray,
) -> None:
    """Write Jx^T r (6,) of a unit."""
    for i in range(OWN):
        b[i] = along[i] * along[OWN] if length_weight > 0.0 else 0.0
    for e in range(2):
        for c in range(pixels.shape[1]):
            if not np.isnan(pixels[e, c, 0]):
                for i in range(3):
                    b[3 * e + i] += Jx[e, c, 0, i] * r[e, c, 0] + Jx[e, c, 1, i] * r[e, c, 1]


@internal
def fit_unit(
    q: FloatArray,
    R: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    motion: FloatArray,
    distance: float,
    weight: float,
    length_weight: float,
    x: FloatArray,
    r: FloatArray,
    Jx: FloatArray,
    along: FloatArray,
    V: FloatArray,
    work: FloatArray,
) -> float:
    """Minimise a unit's sum of squares over its points (Levenberg-Marquardt), in place.

    Args:
        work: (2, 6).

    Returns:
        The minimum, infinite behind a camera; r, Jx and along are those at the minimum.
    """
    step, tried, damping = work[0], work[1], 0.0
    best = fill_residuals(
        q, R, lenses, pixels, motion, distance, weight, length_weight, x, r, Jx, along
    )
    if not best < np.inf:
        return np.inf
    for _ in range(MAXIMUM_STEPS):
        fill_normal_matrix(pixels, Jx, along, length_weight, V)
        fill_gradient(pixels, r, Jx, along, length_weight, step)
        for i in range(OWN):
            V[i, i] *= 1.0 + damping
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
            q, R, lenses, pixels, motion, distance, weight, length_weight, tried, r, Jx, along
        )
        if found <= best:
            best = found
            for i in range(OWN):
                x[i] = tried[i]
            damping *= 0.1
        else:
            damping = max(10.0 * damping, 1e-3)
            fill_residuals(
                q, R, lenses, pixels, motion, distance, weight, length_weight, x, r, Jx, along
            )
        if gain < TOLERANCE * (1.0 + best):
            break
    return best


@internal
def start_unit(
    R: FloatArray, q: FloatArray, rays: FloatArray, x: FloatArray, V: FloatArray
) -> None:
    """Replace a unit's points x (6,), if NaN, by those nearest to the rays of all cameras.

    Args:
        rays: (2, c, 2): undistorted, normalised; NaN where a camera does not see a point.
        V: (3, 3), for work.
    """
    total = 0.0
    for i in range(OWN):
        total += x[i]
    if np.isnan(total):
        for e in range(2):
            nearest_point(R, q, rays[e], x[3 * e : 3 * e + 3], V)


@internal
def nearest_point(
    R: FloatArray, q: FloatArray, rays: FloatArray, b: FloatArray, V: FloatArray
) -> None:
    """Write the point nearest to the rays (c, 2) to b; 1 m in front where there is none."""
    seen = 0
    b[:] = 0.0
    V[:] = 0.0
    for c in range(len(R)):
        x, y = rays[c, 0], rays[c, 1]
        if np.isnan(x):
            continue
        seen += 1
        norm = 1.0 / np.sqrt(x * x + y * y + 1.0)
        at = EACH * c + TRANSLATION
        inner = norm * (x * q[at] + y * q[at + 1] + q[at + 2])
        for i in range(3):
            along = norm * (R[c, 0, i] * x + R[c, 1, i] * y + R[c, 2, i])
            centre = R[c, 0, i] * q[at] + R[c, 1, i] * q[at + 1] + R[c, 2, i] * q[at + 2]
            b[i] += inner * along - centre
            V[i, i] += 1.0
            for j in range(3):
                V[i, j] -= along * norm * (R[c, 0, j] * x + R[c, 1, j] * y + R[c, 2, j])
    if seen > 1 and factor(V, 1e-12):
        forward(V, b)
        backward(V, b)
    else:
        b[0], b[1], b[2] = 0.0, 0.0, 1.0


@internal
def fill_shared(
    q: FloatArray,
    R: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    motion: FloatArray,
    weight: float,
    x: FloatArray,
    Jx: FloatArray,
    by_lens: FloatArray,
    Js: FloatArray,
) -> None:
    """Write the derivatives by the unknowns of the cameras, (2, c, 2, 15), after `fill_residuals`.

    Args:
        by_lens: (2, 4), for work.
    """
    for e in range(2):
        for c in range(len(R)):
            if np.isnan(pixels[e, c, 0]):
                continue
            at, p = EACH * c, 3 * e
            a = R[c, 0, 0] * x[p] + R[c, 0, 1] * x[p + 1] + R[c, 0, 2] * x[p + 2]
            b = R[c, 1, 0] * x[p] + R[c, 1, 1] * x[p + 1] + R[c, 1, 2] * x[p + 2]
            d = R[c, 2, 0] * x[p] + R[c, 2, 1] * x[p + 1] + R[c, 2, 2] * x[p + 2]
            near = 1.0 / (d + q[at + 5])
            nx, ny = (a + q[at + 3]) * near, (b + q[at + 4]) * near
            bx, by, _, _, _, _ = distort(nx, ny, lenses, c)
            for k in range(2):
                row, own = Js[e, c, k], Jx[e, c, k]
                # by the point in the camera's frame
                s0 = own[0] * R[c, 0, 0] + own[1] * R[c, 0, 1] + own[2] * R[c, 0, 2]
                s1 = own[0] * R[c, 1, 0] + own[1] * R[c, 1, 1] + own[2] * R[c, 1, 2]
                s2 = own[0] * R[c, 2, 0] + own[1] * R[c, 2, 1] + own[2] * R[c, 2, 2]
                row[0], row[1], row[2] = b * s2 - d * s1, d * s0 - a * s2, a * s1 - b * s0
                row[3], row[4], row[5] = s0, s1, s2
                row[6], row[7] = weight * bx * (1 - k), weight * by * k
                row[8], row[9] = weight * (1 - k), weight * k
                row[TIME] = weight * motion[e, c, k] if len(motion) else 0.0
            distortion_derivatives(nx, ny, lenses, c, by_lens)
            fx, fy = q[at + LENS], q[at + LENS + 1]
            for i in range(4):
                Js[e, c, 0, DISTORTION + i] = weight * (
                    fx * by_lens[0, i] + lenses[c, 0] * by_lens[1, i]
                )
                Js[e, c, 1, DISTORTION + i] = weight * fy * by_lens[1, i]


@internal
def eliminate(
    q: FloatArray,
    pixels: FloatArray,
    distance: float,
    length_weight: float,
    r: FloatArray,
    Jx: FloatArray,
    Js: FloatArray,
    along: FloatArray,
    L: FloatArray,
    w: float,
    free: BoolArray,
    index: IntArray,
    Y: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> None:
    """Add w times the Schur complement of a unit to H (lower half) and g (see `adjustment`).

    Args:
        L: Cholesky's factor of `fill_normal_matrix`.
        index: (Q,), Y: (Q + 1, 6), for work.
    """
    last = len(q) - 1
    count = active_unknowns(pixels, length_weight, free, index)
    by_factor = -(along[OWN] + length_weight * distance) / q[last]
    fill_gradient(pixels, r, Jx, along, length_weight, Y[last + 1])
    forward(L, Y[last + 1])
    for n in range(count):
        a = index[n]
        c = a // EACH
        own = Y[a]
        if a == last:
            total = along[OWN] * by_factor
            for j in range(OWN):
                own[j] = along[j] * by_factor
        else:
            total = project(pixels, r, Jx, Js, c, a - EACH * c, own)
        forward(L, own)
        for j in range(OWN):
            total -= own[j] * Y[last + 1, j]
        g[a] += w * total
        for m in range(n + 1):
            b = index[m]
            total = 0.0
            if a == last:
                total = by_factor * by_factor if b == last else 0.0
            elif b // EACH == c:
                total = product(pixels, Js, c, a - EACH * c, b - EACH * c)
            for j in range(OWN):
                total -= own[j] * Y[b, j]
            H[a, b] += w * total


@internal
def active_unknowns(
    pixels: FloatArray, length_weight: float, free: BoolArray, index: IntArray
) -> int:
    """Write the unknowns that a unit depends on to `index`, ascending, and return their number."""
    count = 0
    for c in range(pixels.shape[1]):
        if np.isnan(pixels[0, c, 0]) and np.isnan(pixels[1, c, 0]):
            continue
        for i in range(EACH):
            if free[EACH * c + i]:
                index[count] = EACH * c + i
                count += 1
    if length_weight > 0.0 and free[len(free) - 1]:
        index[count] = len(free) - 1
        count += 1
    return count


@internal
def project(
    pixels: FloatArray,
    r: FloatArray,
    Jx: FloatArray,
    Js: FloatArray,
    c: int,
    i: int,
    own: FloatArray,
) -> float:
    """Write Jx^T times an unknown's column of Js to `own` (6,); return the column times r."""
    total = 0.0
    own[:] = 0.0
    for e in range(2):
        if not np.isnan(pixels[e, c, 0]):
            for k in range(2):
                s = Js[e, c, k, i]
                total += s * r[e, c, k]
                for j in range(3):
                    own[3 * e + j] += s * Jx[e, c, k, j]
    return total


@internal
def product(pixels: FloatArray, Js: FloatArray, c: int, i: int, j: int) -> float:
    """The product of two columns of a camera's Js."""
    total = 0.0
    for e in range(2):
        if not np.isnan(pixels[e, c, 0]):
            total += Js[e, c, 0, i] * Js[e, c, 0, j] + Js[e, c, 1, i] * Js[e, c, 1, j]
    return total


@compiled
def sum_normal_equations(
    q: FloatArray,
    R: FloatArray,
    stated_lenses: FloatArray,
    free: BoolArray,
    of_frame: IntArray,
    pixels: FloatArray,
    rays: FloatArray,
    motion: FloatArray,
    distances: FloatArray,
    weight: float,
    length_weight: float,
    limits: FloatArray,
    points: FloatArray,
    chi_squares: FloatArray,
    H: FloatArray,
    g: FloatArray,
) -> float:
    """Fit the points of all units, sum the normal equations, and return the cost.

    Args:
        free: (Q,): which unknowns are not held fixed; H and g are 0 for the others.
        of_frame: (n,): the frame of each unit.
        pixels, rays: (n, 2, c, 2); motion: the same, or empty.
        distances: (n,): in metres; NaN without a known length.
        limits: (f,): of `adjustment.loss`, by frame.
        points: (n, 6), updated; NaN where first points are needed.
        chi_squares: (f,), H (Q, Q) and g (Q,): written.
    """
    cameras, unknowns = len(R), len(q)
    lenses = lenses_at(q, stated_lenses)
    r, Jx = np.zeros((2, cameras, 2)), np.zeros((2, cameras, 2, 3))
    Js, along = np.zeros((2, cameras, 2, EACH)), np.zeros(OWN + 1)
    V, small, work, by_lens = np.empty((6, 6)), np.empty((3, 3)), np.empty((2, 6)), np.empty((2, 4))
    index, Y = np.empty(unknowns, np.int64), np.empty((unknowns + 1, OWN))
    H[:] = 0.0
    g[:] = 0.0
    chi_squares[:] = 0.0
    still = np.empty((0, cameras, 2))
    for n in range(len(pixels)):
        own = 0.0 if np.isnan(distances[n]) else length_weight
        moving = motion[n] if len(motion) else still
        start_unit(R, q, rays[n], points[n], small)
        s = fit_unit(
            q,
            R,
            lenses,
            pixels[n],
            moving,
            distances[n],
            weight,
            own,
            points[n],
            r,
            Jx,
            along,
            V,
            work,
        )
        chi_squares[of_frame[n]] += s
        if not s < np.inf:
            points[n] = np.nan
    cost = 0.0
    for f in range(len(limits)):
        cost += loss(chi_squares[f], limits[f])[0]
    for n in range(len(pixels)):
        f = of_frame[n]
        w = loss(chi_squares[f], limits[f])[1]
        if not (w > 0.0 and chi_squares[f] < np.inf):
            continue
        own = 0.0 if np.isnan(distances[n]) else length_weight
        moving = motion[n] if len(motion) else still
        fill_residuals(
            q, R, lenses, pixels[n], moving, distances[n], weight, own, points[n], r, Jx, along
        )
        fill_shared(q, R, lenses, pixels[n], moving, weight, points[n], Jx, by_lens, Js)
        fill_normal_matrix(pixels[n], Jx, along, own, V)
        if factor(V, 0.0):
            eliminate(q, pixels[n], distances[n], own, r, Jx, Js, along, V, w, free, index, Y, H, g)
    for i in range(unknowns):
        for j in range(i):
            H[j, i] = H[i, j]
    return cost


@internal
def lenses_at(q: FloatArray, stated: FloatArray) -> FloatArray:
    """A copy of the stated lenses (c, 23) with the k1, k2, p1, p2 of q."""
    lenses = stated.copy()
    for c in range(len(stated)):
        for i in range(4):
            lenses[c, 1 + i] = q[EACH * c + DISTORTION + i]
    return lenses


@compiled
def length_innovations(
    q: FloatArray,
    R: FloatArray,
    stated_lenses: FloatArray,
    pixels: FloatArray,
    distances: FloatArray,
    weight: float,
    points: FloatArray,
    found: FloatArray,
) -> None:
    """As `adjustment.length_innovations`, of units of N views: `found` (n, 2), written."""
    lenses, cameras = lenses_at(q, stated_lenses), len(R)
    r, Jx, along = np.zeros((2, cameras, 2)), np.zeros((2, cameras, 2, 3)), np.zeros(OWN + 1)
    V, gradient, still = np.empty((6, 6)), np.empty(OWN), np.empty((0, cameras, 2))
    for n in range(len(pixels)):
        found[n, 0] = found[n, 1] = np.nan
        if np.isnan(distances[n]) or np.isnan(points[n, 0]):
            continue
        s = fill_residuals(
            q, R, lenses, pixels[n], still, distances[n], weight, 1.0, points[n], r, Jx, along
        )
        if not s < np.inf:
            continue
        for i in range(OWN):
            gradient[i] = along[i]
        fill_normal_matrix(pixels[n], Jx, along, 0.0, V)
        if factor(V, 0.0):
            forward(V, gradient)
            found[n, 0], found[n, 1] = along[OWN], 0.0
            for i in range(OWN):
                found[n, 1] += gradient[i] * gradient[i]


@compiled
def fill_point_fits(
    q: FloatArray,
    R: FloatArray,
    stated_lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    points: FloatArray,
    residuals: FloatArray,
    covariances: FloatArray,
    by_shared: FloatArray,
) -> None:
    """Points of the least sum of squared pixel residuals, from all views of each.

    Args:
        pixels, rays: (n, c, 2); NaN where a camera does not see a point.
        points: (n, 3), residuals: (n, c, 2) in pixels, covariances: (n, 3, 3) for noise of 1 px:
            written; NaN where there is no such point.
        by_shared: (n, 3, Q), written: derivatives of the points by the unknowns; or empty.
    """
    cameras = len(R)
    lenses = lenses_at(q, stated_lenses)
    r, Jx = np.zeros((2, cameras, 2)), np.zeros((2, cameras, 2, 3))
    Js, along = np.zeros((2, cameras, 2, EACH)), np.zeros(OWN + 1)
    V, small, work, by_lens = np.empty((6, 6)), np.empty((3, 3)), np.empty((2, 6)), np.empty((2, 4))
    x, b = np.empty(OWN), np.empty(OWN)
    seen, ray = np.full((2, cameras, 2), np.nan), np.full((2, cameras, 2), np.nan)
    still = np.empty((0, cameras, 2))
    for n in range(len(pixels)):
        points[n], residuals[n], covariances[n] = np.nan, np.nan, np.nan
        if len(by_shared):
            by_shared[n] = np.nan
        seen[0], ray[0] = pixels[n], rays[n]
        if np.isfinite(pixels[n, :, 0]).sum() < 2:
            continue
        x[:] = np.nan
        start_unit(R, q, ray, x, small)
        s = fit_unit(q, R, lenses, seen, still, 0.0, 1.0, 0.0, x, r, Jx, along, V, work)
        if not s < np.inf:
            continue
        fill_normal_matrix(seen, Jx, along, 0.0, V)
        if not factor(V, 1e-14):
            continue
        residuals[n] = np.where(np.isnan(seen[0]), np.nan, r[0])
        points[n] = x[:3]
        for j in range(3):
            b[:] = 0.0
            b[j] = 1.0
            forward(V, b)
            backward(V, b)
            covariances[n, :, j] = b[:3]
        if len(by_shared):
            fill_shared(q, R, lenses, seen, still, 1.0, x, Jx, by_lens, Js)
            fill_point_derivatives(seen[0], Jx[0], Js[0], covariances[n], by_shared[n])


@internal
def fill_point_derivatives(
    pixels: FloatArray, Jx: FloatArray, Js: FloatArray, covariance: FloatArray, by: FloatArray
) -> None:
    """Write the derivatives of a fitted point by the unknowns, (3, Q)."""
    by[:] = 0.0
    for c in range(len(pixels)):
        if np.isnan(pixels[c, 0]):
            continue
        for k in range(2):
            for j in range(3):
                gain = 0.0
                for m in range(3):
                    gain += covariance[j, m] * Jx[c, k, m]
                for i in range(EACH):
                    by[j, EACH * c + i] -= gain * Js[c, k, i]
