"""Points seen by N cameras: residuals, normal equations and their least squares, compiled.

The unknowns `q` are, camera by camera, 16 values: a small rotation of the camera about its own axes
(x_camera = exp(w) R x + T), T in metres, fx, fy, cx, cy, k1, k2, p1, p2, by how many frames the
camera is late, and by how many more per frame; after those of all cameras, if any looks through a
window, 5 of the window of each (`windows`); at last the factor of the object's lengths. R is kept
apart, and w is 0 after each step. The five angles of the paper, which have poles, are in its
methods and in parameter files (`parameter_file`), nowhere else.

Points come in units of two: the ends of a known length, or one point and nothing. Given q, units
are independent, so that each is fitted and eliminated by itself (Schur complement): time and memory
grow linearly with their number. The residuals are pixels over sigma_px, and the length over the
factor minus the stated one, over its scatter. Divided by the factor, a change of scale changes no
residual. Else a smaller scene has smaller errors of lengths: with wide priors and 20,000 bars the
least squares shrank it without end.
"""

from typing import NamedTuple

import numpy as np

from stereocal.fit.least_squares.distortion import distort, distortion_derivatives, set_distortion
from stereocal.fit.least_squares.windows import (
    NO_WINDOWS,
    OF_WINDOW,
    before_window,
    fill_by_window,
    nearest_behind_windows,
    seen_in_air,
)
from stereocal.rig.compiled import compiled, contiguous, inlined
from stereocal.rig.decompositions import backward, factor, forward
from stereocal.system.array_types import FloatArray

EACH = 16
"""Unknowns of a camera."""
TRANSLATION, LENS, DISTORTION, TIME, DRIFT = 3, 6, 10, 14, 15
"""Where they begin, after the rotation at 0."""
OWN = 6
"""Coordinates of the two points of a unit; the length's residual stands after its derivatives."""
MAXIMUM_STEPS = 12
TOLERANCE = 1e-6
"""Relative reduction of a unit's sum of squares by a step, below which its points have converged
(measured: the remaining reduction is below 1e-9)."""


class Cameras(NamedTuple):
    """N cameras: the unknowns (Q,), R (c, 3, 3), and skew and `distortion.lens_terms` (c, 23)."""

    q: FloatArray
    R: FloatArray
    lenses: FloatArray
    windows: FloatArray = NO_WINDOWS
    """As of `windows`."""


class Units(NamedTuple):
    """What was measured of n units. The weights are one over standard deviations."""

    pixels: FloatArray
    """(n, 2, c, 2); NaN where a camera does not see a point."""
    rays: FloatArray
    """(n, 2, c, 2): undistorted with the stated lenses, for first points."""
    motion: FloatArray
    """(n, 2, c, 3): velocities in pixels per frame, and the frame from which the drift counts;
    empty if the cameras are in step."""
    distances: FloatArray
    """(n,): in metres; NaN without a known length."""
    weight: float
    length_weight: float


class Unit(NamedTuple):
    """One of them; its `length_weight` is 0 without a known length."""

    pixels: FloatArray
    motion: FloatArray
    distance: float
    weight: float
    length_weight: float


class Work(NamedTuple):
    """Residuals r (2, c, 2) of a unit, written where there are pixels, their derivatives Jx
    (2, c, 2, 3) by the points and Js (2, c, 2, 16) by the unknowns of the cameras, with windows
    (2, c, 2, 21) by theirs too, those of the length's residual and itself, `along` (7,), the normal
    matrix V (6, 6) of the points or its factor; and room for what the computation needs.
    """

    r: FloatArray
    Jx: FloatArray
    Js: FloatArray
    along: FloatArray
    V: FloatArray
    step: FloatArray
    tried: FloatArray
    small: FloatArray
    by_lens: FloatArray
    refraction: FloatArray


@compiled
def with_lenses(stated: Cameras) -> Cameras:
    """The cameras with the k1, k2, p1, p2 of their unknowns instead of the stated ones."""
    lenses = set_distortion(stated.q, DISTORTION, EACH, stated.lenses)
    return Cameras(stated.q, stated.R, lenses, stated.windows)


@compiled
def work_of(cameras: int, windows: int = 0) -> Work:
    """The arrays for units that this number of cameras sees, through windows if there are any."""
    columns = EACH + OF_WINDOW if windows else EACH
    return Work(
        np.zeros((2, cameras, 2)),
        np.zeros((2, cameras, 2, 3)),
        np.zeros((2, cameras, 2, columns)),
        np.zeros(OWN + 1),
        np.empty((OWN, OWN)),
        np.empty(OWN),
        np.empty(OWN),
        np.empty((3, 3)),
        np.empty((2, 4)),
        np.empty((2, 14)),
    )


@compiled
def fill_residuals(
    cameras: Cameras, windows: FloatArray, unit: Unit, x: FloatArray, work: Work
) -> float:
    """Write the residuals of a unit at points x (6,), in the reference's frame, and their
    derivatives by these; return the sum of squares, infinite behind a camera.

    End e in camera c: X = R x_e + T, behind a window where it is seen in air (`windows`), n =
    (X, Y) / Z, b = distort(n), and with the weight w, the seen pixel (u, v) and its velocity (u',
    v'), which a delay shifts,

        r = w (fx bx + skew by + cx - (u - delay u'),  fy by + cy - (v - delay v')).

    Its derivatives by X are those by n, divided by Z, and by Z minus n times these; by x_e they are
    that row times R. The length's residual is w_l (|x_A - x_B| / factor - distance).

    Args:
        windows: those of the cameras, by themselves: numba then compiles the case of air without
            them, and to the digit what it was.
    """
    q, R, lenses, _ = cameras
    pixels, motion, distance, weight, length_weight = unit
    r, Jx, along = work.r, work.Jx, work.along
    total = 0.0
    for e in range(2):
        for c in range(len(R)):
            if np.isnan(pixels[e, c, 0]):
                continue
            first, p = EACH * c, 3 * e
            X = R[c, 0, 0] * x[p] + R[c, 0, 1] * x[p + 1] + R[c, 0, 2] * x[p + 2] + q[first + 3]
            Y = R[c, 1, 0] * x[p] + R[c, 1, 1] * x[p + 1] + R[c, 1, 2] * x[p + 2] + q[first + 4]
            Z = R[c, 2, 0] * x[p] + R[c, 2, 1] * x[p + 1] + R[c, 2, 2] * x[p + 2] + q[first + 5]
            if windows.ndim == 2:
                X, Y, Z = seen_in_air(windows, q, R, c, first, X, Y, Z, work.refraction)
            if not Z > 0.0:
                return np.inf
            near, fx, fy, skew = 1.0 / Z, q[first + LENS], q[first + LENS + 1], lenses[c, 0]
            nx, ny = X * near, Y * near
            bx, by, xx, xy, yx, yy = distort(nx, ny, lenses, c)
            u, v = pixels[e, c, 0], pixels[e, c, 1]
            if len(motion):
                delay = q[first + TIME] + q[first + DRIFT] * motion[e, c, 2]
                u -= delay * motion[e, c, 0]
                v -= delay * motion[e, c, 1]
            r[e, c, 0] = weight * (fx * bx + skew * by + q[first + LENS + 2] - u)
            r[e, c, 1] = weight * (fy * by + q[first + LENS + 3] - v)
            total += r[e, c, 0] ** 2 + r[e, c, 1] ** 2
            scale = weight * near
            # Derivatives of both residuals by X, Y and Z.
            ux, uy = scale * (fx * xx + skew * yx), scale * (fx * xy + skew * yy)
            vx, vy = scale * fy * yx, scale * fy * yy
            uz, vz = -(ux * nx + uy * ny), -(vx * nx + vy * ny)
            if windows.ndim == 2:
                ux, uy, uz = before_window(windows, c, ux, uy, uz, work.refraction)
                vx, vy, vz = before_window(windows, c, vx, vy, vz, work.refraction)
            for j in range(3):
                Jx[e, c, 0, j] = ux * R[c, 0, j] + uy * R[c, 1, j] + uz * R[c, 2, j]
                Jx[e, c, 1, j] = vx * R[c, 0, j] + vy * R[c, 1, j] + vz * R[c, 2, j]
    if length_weight > 0.0:
        total += _fill_length(q[len(q) - 1], distance, length_weight, x, along)
    return total


@inlined
def _fill_length(
    factor_of_length: float, distance: float, length_weight: float, x: FloatArray, along: FloatArray
) -> float:
    """Write the derivatives of the length's residual and itself; return its square."""
    square = 0.0
    for j in range(3):
        square += (x[j] - x[j + 3]) ** 2
    length = np.sqrt(square)
    along[OWN] = length_weight * (length / factor_of_length - distance)
    for j in range(3):
        along[j] = length_weight / (factor_of_length * length) * (x[j] - x[j + 3])
        along[j + 3] = -along[j]
    return float(along[OWN] ** 2)


@compiled
def fill_normal_matrix(unit: Unit, length_weight: float, work: Work) -> None:
    """Write the lower half of the normal matrix of a unit's points; 1 for one not seen."""
    pixels, Jx, along, V = unit.pixels, work.Jx, work.along, work.V
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


@compiled
def fill_gradient(unit: Unit, work: Work, b: FloatArray) -> None:
    """Write Jx^T r (6,) of a unit."""
    pixels, r, Jx, along = unit.pixels, work.r, work.Jx, work.along
    for i in range(OWN):
        b[i] = along[i] * along[OWN] if unit.length_weight > 0.0 else 0.0
    for e in range(2):
        for c in range(pixels.shape[1]):
            if not np.isnan(pixels[e, c, 0]):
                for i in range(3):
                    b[3 * e + i] += Jx[e, c, 0, i] * r[e, c, 0] + Jx[e, c, 1, i] * r[e, c, 1]


@compiled
def fit_unit(cameras: Cameras, unit: Unit, x: FloatArray, work: Work) -> float:
    """Minimise a unit's sum of squares over its points x (6,) in place (Levenberg-Marquardt).

    Solves (V + damping diag(V)) step = Jx^T r by V = L L^T; |L^-1 Jx^T r|^2, the `gain`, is the
    predicted decrease. It begins undamped (Gauss-Newton), as the points nearest to the rays are so
    near that no step of the bars of sample_data/field fails: 108 evaluations for 25 bars, and 174
    beginning at 1e-3. The factors 0.1 and 10 and the least damping of 1e-3 after a step that fails
    serve points far off; a quarter or four times of each changes nothing there.

    Returns:
        The minimum, infinite behind a camera; the residuals and derivatives are those there.
    """
    step, tried, V, damping = work.step, work.tried, work.V, 0.0
    best = fill_residuals(cameras, cameras.windows, unit, x, work)
    if not best < np.inf:
        return np.inf
    for _ in range(MAXIMUM_STEPS):
        fill_normal_matrix(unit, unit.length_weight, work)
        fill_gradient(unit, work, step)
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
        total = fill_residuals(cameras, cameras.windows, unit, tried, work)
        if total <= best:
            best = total
            for i in range(OWN):
                x[i] = tried[i]
            damping *= 0.1
        else:
            damping = max(10.0 * damping, 1e-3)
            fill_residuals(cameras, cameras.windows, unit, x, work)
        if gain < TOLERANCE * (1.0 + best):
            break
    return best


@compiled
def start_unit(cameras: Cameras, rays: FloatArray, x: FloatArray, V: FloatArray) -> None:
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
            b = x[3 * e : 3 * e + 3]
            if not nearest_behind_windows(cameras.windows, cameras.q, cameras.R, rays[e], b, V):
                nearest_point(cameras.R, cameras.q, rays[e], b, V)


@compiled
def nearest_point(
    R: FloatArray, q: FloatArray, rays: FloatArray, b: FloatArray, V: FloatArray
) -> None:
    """Write the point nearest to the rays (c, 2) to b; 1 m in front where there is none.

    A ray begins at the camera's centre C = -R^T T with the direction a = R^T (x, y, 1) / |(x, y,
    1)|. The squared distances of a point from the rays have their least sum where
    sum(1 - a a^T) point = sum(1 - a a^T) C; as a^T C = -(x, y, 1) T / |(x, y, 1)|, which is minus
    `inner`, the right side is sum(inner a + C).

    Args:
        b: (3,), V: (3, 3), for work too.
    """
    seen = 0
    b[:] = 0.0
    V[:] = 0.0
    for c in range(len(R)):
        x, y = rays[c, 0], rays[c, 1]
        if np.isnan(x):
            continue
        seen += 1
        norm = 1.0 / np.sqrt(x * x + y * y + 1.0)
        first = EACH * c + TRANSLATION
        inner = norm * (x * q[first] + y * q[first + 1] + q[first + 2])
        for i in range(3):
            along = norm * (R[c, 0, i] * x + R[c, 1, i] * y + R[c, 2, i])
            centre = R[c, 0, i] * q[first] + R[c, 1, i] * q[first + 1] + R[c, 2, i] * q[first + 2]
            b[i] += inner * along - centre
            V[i, i] += 1.0
            for j in range(3):
                V[i, j] -= along * norm * (R[c, 0, j] * x + R[c, 1, j] * y + R[c, 2, j])
    if seen > 1 and factor(V, 1e-12):
        forward(V, b)
        backward(V, b)
    else:
        b[0], b[1], b[2] = 0.0, 0.0, 1.0


@compiled
def fill_shared(cameras: Cameras, unit: Unit, x: FloatArray, distorted: bool, work: Work) -> None:
    """Write the derivatives by the unknowns of the cameras, after `fill_residuals`.

    With y = R x_e = (a, b, d) and s the derivative of a residual by the point X = y + T in the
    camera's frame (its row of Jx times R^T): by the rotation y x s, as exp(w) y = y + w x y; by T
    s; by fx and fy the distorted point; by cx and cy 1, all times the weight.

    Args:
        distorted: whether those by the distortion are wanted; else they stay as they are.
    """
    q, R, lenses, windows = cameras
    pixels, motion, weight = unit.pixels, unit.motion, unit.weight
    Jx, Js, by_lens = work.Jx, work.Js, work.by_lens
    for e in range(2):
        for c in range(len(R)):
            if np.isnan(pixels[e, c, 0]):
                continue
            first, p = EACH * c, 3 * e
            a = R[c, 0, 0] * x[p] + R[c, 0, 1] * x[p + 1] + R[c, 0, 2] * x[p + 2]
            b = R[c, 1, 0] * x[p] + R[c, 1, 1] * x[p + 1] + R[c, 1, 2] * x[p + 2]
            d = R[c, 2, 0] * x[p] + R[c, 2, 1] * x[p + 1] + R[c, 2, 2] * x[p + 2]
            X, Y, Z = a + q[first + 3], b + q[first + 4], d + q[first + 5]
            X, Y, Z = seen_in_air(windows, q, R, c, first, X, Y, Z, work.refraction)
            near = 1.0 / Z
            nx, ny = X * near, Y * near
            bx, by, xx, xy, yx, yy = distort(nx, ny, lenses, c)
            for k in range(2):
                row, by_point = Js[e, c, k], Jx[e, c, k]
                s0 = by_point[0] * R[c, 0, 0] + by_point[1] * R[c, 0, 1] + by_point[2] * R[c, 0, 2]
                s1 = by_point[0] * R[c, 1, 0] + by_point[1] * R[c, 1, 1] + by_point[2] * R[c, 1, 2]
                s2 = by_point[0] * R[c, 2, 0] + by_point[1] * R[c, 2, 1] + by_point[2] * R[c, 2, 2]
                row[0], row[1], row[2] = b * s2 - d * s1, d * s0 - a * s2, a * s1 - b * s0
                row[3], row[4], row[5] = s0, s1, s2
                row[6], row[7] = weight * bx * (1 - k), weight * by * k
                row[8], row[9] = weight * (1 - k), weight * k
                row[TIME] = weight * motion[e, c, k] if len(motion) else 0.0
                row[DRIFT] = row[TIME] * motion[e, c, 2] if len(motion) else 0.0
            slopes = near, xx, xy, yx, yy, nx, ny
            fill_by_window(
                windows, q, R, lenses, c, first, weight, slopes, work.refraction, Js[e, c]
            )
            if not distorted:
                continue
            distortion_derivatives(nx, ny, lenses, c, by_lens)
            fx, fy = q[first + LENS], q[first + LENS + 1]
            for i in range(4):
                Js[e, c, 0, DISTORTION + i] = weight * (
                    fx * by_lens[0, i] + lenses[c, 0] * by_lens[1, i]
                )
                Js[e, c, 1, DISTORTION + i] = weight * fy * by_lens[1, i]


class PointFits(NamedTuple):
    """Points (n, 3) of the least sum of squared pixel residuals, these (n, c, 2), covariances
    (n, 3, 3) for noise of 1 px, and derivatives (n, 3, Q) by the unknowns, empty if not asked for;
    NaN where there is no such point.
    """

    points: FloatArray
    residuals: FloatArray
    covariances: FloatArray
    by_shared: FloatArray


def fit_points(
    cameras: Cameras, pixels: FloatArray, rays: FloatArray, derivatives: bool = False
) -> PointFits:
    """The points of all their views.

    Args:
        cameras: with the stated k1, k2, p1, p2.
        pixels, rays: (n, c, 2); NaN where a camera does not see a point.
    """
    n = len(pixels)
    fits = PointFits(
        np.full((n, 3), np.nan),
        np.full(pixels.shape, np.nan),
        np.full((n, 3, 3), np.nan),
        np.full((n if derivatives else 0, 3, len(cameras.q)), np.nan),
    )
    _fill_fits(cameras, np.ascontiguousarray(pixels), np.ascontiguousarray(rays), fits)
    if derivatives:
        rows = np.flatnonzero(np.isfinite(fits.points[:, 0]))
        by_point, by_view = jacobians_of(cameras, fits.points[rows])
        by_point[np.isnan(pixels[rows, :, 0])] = 0.0
        gain = np.einsum("nij,nckj->nick", fits.covariances[rows], by_point)
        by_unknown = -np.einsum("nick,nckv->nicv", gain, by_view)
        parts = by_unknown[..., :EACH], by_unknown[..., EACH:]
        flat = [part.reshape(len(rows), 3, -1) for part in parts]
        fits.by_shared[rows, :, :-1] = np.concatenate(flat, axis=2)
        fits.by_shared[rows, :, -1] = 0.0
    return fits


@compiled
def _fill_fits(stated: Cameras, pixels: FloatArray, rays: FloatArray, fits: PointFits) -> None:
    cameras, count = with_lenses(stated), len(stated.R)
    work, x, b = work_of(count, len(stated.windows)), np.empty(OWN), np.empty(OWN)
    seen, ray = np.full((2, count, 2), np.nan), np.full((2, count, 2), np.nan)
    unit = Unit(seen, np.empty((0, count, 3)), 0.0, 1.0, 0.0)
    for n in range(len(pixels)):
        copy_views(rays[n], ray[0])
        if copy_views(pixels[n], seen[0]) < 2:
            continue
        x[:] = np.nan
        start_unit(cameras, ray, x, work.small)
        if not fit_unit(cameras, unit, x, work) < np.inf:
            continue
        fill_normal_matrix(unit, 0.0, work)
        if not factor(work.V, 1e-14):
            continue
        copy_views(work.r[0], fits.residuals[n])
        for c in range(count):
            if np.isnan(seen[0, c, 0]):
                fits.residuals[n, c, 0] = fits.residuals[n, c, 1] = np.nan
        for j in range(3):
            fits.points[n, j] = x[j]
            b[:] = 0.0
            b[j] = 1.0
            forward(work.V, b)
            backward(work.V, b)
            for i in range(3):
                fits.covariances[n, i, j] = b[i]


@compiled
def copy_views(views: FloatArray, to: FloatArray) -> int:
    """Copy values (c, 2) of each camera; how many of them are there."""
    there = 0
    for c in range(len(views)):
        there += not np.isnan(views[c, 0])
        to[c, 0], to[c, 1] = views[c, 0], views[c, 1]
    return there


def jacobians_of(cameras: Cameras, points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the pixels of points (n, 3) in all cameras, NaN behind a camera.

    Args:
        cameras: with the stated k1, k2, p1, p2.

    Returns:
        By the point (n, c, 2, 3), and by the unknowns of each camera (n, c, 2, 16), with windows
        (n, c, 2, 21).
    """
    shape, columns = (len(points), len(cameras.R), 2), EACH + OF_WINDOW * (len(cameras.windows) > 0)
    by_point, by_shared = np.full((*shape, 3), np.nan), np.full((*shape, columns), np.nan)
    _fill_jacobians(cameras, contiguous(points), by_point, by_shared)
    return by_point, by_shared


@compiled
def _fill_jacobians(
    stated: Cameras, points: FloatArray, by_point: FloatArray, by_shared: FloatArray
) -> None:
    cameras, count = with_lenses(stated), len(stated.R)
    pixels, x = np.full((2, count, 2), np.nan), np.zeros(OWN)
    work = work_of(count, len(stated.windows))
    pixels[0] = 0.0
    unit = Unit(pixels, np.empty((0, count, 3)), 0.0, 1.0, 0.0)
    for n in range(len(points)):
        for i in range(3):
            x[i] = points[n, i]
        if fill_residuals(cameras, cameras.windows, unit, x, work) < np.inf:
            fill_shared(cameras, unit, x, True, work)
            for c in range(count):
                for k in range(2):
                    for i in range(3):
                        by_point[n, c, k, i] = work.Jx[0, c, k, i]
                    for i in range(by_shared.shape[3]):
                        by_shared[n, c, k, i] = work.Js[0, c, k, i]
