"""Method 1, the essential matrix (paper, Section 3.1), with the scale of the measured baseline.

`solver="linear"`: the normalised 8-point estimate (Hartley), projected to an essential matrix, as
the textbooks do; the five-point estimate where there are fewer than 8 pairs. `solver="constrained"`
goes on from there to the minimiser of the sum of squared residuals over the five angles: the
paper's "two constraints" (its footnote 1) hold exactly.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from stereocal.compilations import clock
from stereocal.compiled import FloatArray, compiled
from stereocal.decompositions import singular_vectors, solve_positive, triangle
from stereocal.errors import StereocalError
from stereocal.geometry import Angles, Pose, fill_essential, fill_pose, midpoint

Solver = Literal["constrained", "linear"]
MINIMUM_PAIRS = 5
LINEAR_PAIRS = 8
MOST_ROUNDS = 200
SMALLEST_STEP = 1e-7
"""rad. A smaller step that does not lower the cost is one that rounding hides."""


@dataclass(frozen=True, eq=False)
class EssentialResult:
    """The pose that the essential matrix gives, its cost, and how it was found."""

    pose: Pose
    cost: float
    """Sum of squared residuals (no unit)."""
    evaluations: int
    stop_reason: str
    seconds: float
    solver: Solver


def calibrate_essential(
    rays: FloatArray,
    baseline: float,
    solver: Solver = "constrained",
    tie_breaker: Callable[[Pose], float] | None = None,
    start: Pose | None = None,
) -> EssentialResult:
    """The pose of the rig from pairs of normalised points.

    Args:
        rays: (4, n), as in `geometry`; n >= 5.
        baseline: measured distance between the cameras, in metres.
        tie_breaker: a cost that tells poses apart which fit equally well. Five pairs fit up to ten
            essential matrices exactly.
        start: where to begin instead of at the 8-point or 5-point estimate.

    Raises:
        StereocalError: fewer than 5 pairs, or points that determine no pose.
    """
    started = clock()
    pairs = rays.shape[1]
    if pairs < MINIMUM_PAIRS:
        raise StereocalError(
            f"There are {pairs} pairs of points; at least {MINIMUM_PAIRS} are needed."
        )
    if start is not None:
        candidates = [start.essential]
        stop_reason = "as it was begun"
    elif pairs >= LINEAR_PAIRS:
        candidates = [linear_essential(rays)]
        stop_reason = "solved in one step (8-point)"
    else:
        candidates = _five_point(rays)
        stop_reason = "solved in one step (5-point)"
    if not candidates or not all(np.isfinite(E).all() for E in candidates):
        raise StereocalError(
            "The points do not determine how the cameras stand: they lie too close together, or "
            "all alike. Spread the bar over the whole view and over different depths."
        )
    found = []
    for E in candidates:
        R, t, in_front = choose_pose(E, rays)
        if in_front:
            pose = Pose(R, t)
            found.append((in_front, _sum_of_squares(pose, rays), pose))
    if not found:
        raise StereocalError(
            "No position of the cameras has the points in front of both. Check that the points of "
            "the two cameras, and the two camera files, are not exchanged."
        )
    # Solved with a baseline of 1, so that the direction does not depend on what was measured.
    cost, pose = _best(found, baseline, tie_breaker)
    evaluations = len(candidates)
    if solver == "constrained":
        angles, more, converged = constrain(np.array(pose.angles), rays)
        pose = Pose.from_angles(Angles(*angles.tolist()), 1.0)
        cost = _sum_of_squares(pose, rays)
        evaluations += more
        stop_reason = "converged" if converged else "the largest number of rounds was reached"
    pose = Pose(pose.R, baseline * pose.T)
    return EssentialResult(pose, cost, evaluations, stop_reason, clock() - started, solver)


def _best(
    found: list[tuple[int, float, Pose]],
    baseline: float,
    tie_breaker: Callable[[Pose], float] | None,
) -> tuple[float, Pose]:
    """Most points in front, then least residual; exact fits are told apart by `tie_breaker`."""
    most = max(in_front for in_front, _, _ in found)
    left = [(cost, pose) for in_front, cost, pose in found if in_front == most]
    least = min(cost for cost, _ in left)
    # Residuals of an exact fit are rounding: 1e-15 each on rays of order 1.
    ties = [(cost, pose) for cost, pose in left if cost <= max(least, 1e-24)]
    if len(ties) > 1 and tie_breaker is not None:
        return min(
            ties,
            key=lambda tie: np.nan_to_num(
                tie_breaker(Pose(tie[1].R, baseline * tie[1].T)), nan=np.inf
            ),
        )
    return min(ties, key=lambda tie: tie[0])


def _sum_of_squares(pose: Pose, rays: FloatArray) -> float:
    return float(np.sum((pose.essential.ravel() @ _coefficients(rays)) ** 2))


def _five_point(rays: FloatArray) -> list[FloatArray]:
    """Essential matrices of all subsets of 5 pairs (Nister's solver, from OpenCV).

    None where the pairs give fewer than 5 conditions, such as one pair given five times.
    """
    singular = np.linalg.svd(_coefficients(rays), compute_uv=False)
    if singular[MINIMUM_PAIRS - 1] < 1e-12 * singular[0]:
        return []
    candidates: list[FloatArray] = []
    for subset in itertools.combinations(range(rays.shape[1]), MINIMUM_PAIRS):
        p = np.ascontiguousarray(rays[:2, subset].T)
        q = np.ascontiguousarray(rays[2:, subset].T)
        stacked, _ = cv2.findEssentialMat(p, q, np.eye(3), method=cv2.RANSAC, threshold=1e-3)
        if stacked is not None:
            candidates += list(np.asarray(stacked, dtype=np.float64).reshape(-1, 3, 3))
    return candidates


@compiled
def linear_essential(rays: FloatArray) -> FloatArray:
    """The 8-point estimate with Hartley's normalisation, projected to an essential matrix (3, 3).

    NaN where the points do not determine it.
    """
    normalised, u, v, a = np.empty_like(rays), np.empty(2), np.empty(2), np.empty(2)
    for camera in range(2):
        own = rays[2 * camera : 2 * camera + 2]
        u[camera], v[camera] = own[0].mean(), own[1].mean()
        squares = (own[0] - u[camera]) ** 2 + (own[1] - v[camera]) ** 2
        a[camera] = 1.0 / np.sqrt(0.5 * squares.mean())  # mean square 1 along each axis
        normalised[2 * camera] = a[camera] * (own[0] - u[camera])
        normalised[2 * camera + 1] = a[camera] * (own[1] - v[camera])
    _, singular, vt = singular_vectors(triangle(_coefficients(normalised)))
    E = np.full((3, 3), np.nan)
    if not singular[7] >= 1e-12 * singular[0]:
        return E
    F = vt[8].copy().reshape(3, 3)
    # Back to the rays as they were: first the columns (primary), then the rows (secondary).
    F[:, 2] -= a[0] * (u[0] * F[:, 0] + v[0] * F[:, 1])
    F[:, :2] *= a[0]
    F[2] -= a[1] * (u[1] * F[0] + v[1] * F[1])
    F[:2] *= a[1]
    U, singular, vt = singular_vectors(F)
    for i in range(3):
        for j in range(3):
            E[i, j] = U[0, i] / singular[0] * vt[0, j] + U[1, i] / singular[1] * vt[1, j]
    return E


@compiled
def choose_pose(E: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """The one of E's four poses with the most points in front of both cameras.

    Returns R, the unit vector t, and how many points are in front.
    """
    U, singular, vt = singular_vectors(E)
    u, v = U[:2] / singular[:2].reshape(2, 1), vt[:2]
    normal_u, normal_v = _cross(u[0], u[1]), _cross(v[0], v[1])
    best_R, best_t, most = np.eye(3), normal_u, -1
    for turn in (1.0, -1.0):
        R = np.empty((3, 3))
        for i in range(3):
            for j in range(3):
                R[i, j] = turn * (u[1, i] * v[0, j] - u[0, i] * v[1, j]) + normal_u[i] * normal_v[j]
        for sign in (1.0, -1.0):
            t = sign * normal_u
            in_front = 0
            for k in range(rays.shape[1]):
                z = midpoint(R, t, rays[0, k], rays[1, k], rays[2, k], rays[3, k])[2]
                in_front += 0 if np.isnan(z) else 1
            if in_front > most:
                best_R, best_t, most = R, t, in_front
    return best_R, best_t, most


@compiled
def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    x, y, z = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    return np.array([x, y, z])


@compiled
def constrain(start: FloatArray, rays: FloatArray) -> tuple[FloatArray, int, bool]:
    """Minimise the sum of squared residuals over the five angles (Levenberg-Marquardt).

    A residual is linear in E, so n residuals have the sum of squares of the 9 numbers `r @ vec(E)`,
    where `r` is the triangle of the QR decomposition of their (n, 9) coefficients: a round costs
    the same for 40 pairs and for 40,000.

    Returns the angles, the evaluations, and whether it converged.
    """
    r = triangle(_coefficients(rays))
    angles = start.copy()
    residual = _times(r, _essential(angles))
    cost, damping, evaluations = (residual**2).sum(), 1e-4, 1
    J = _jacobian(r, angles)
    while evaluations < MOST_ROUNDS and damping < 1e12:
        solved, step = _damped_step(J, residual, damping)
        candidate = _times(r, _essential(angles + step))
        evaluations += 1
        small = np.abs(step).max() < SMALLEST_STEP
        if solved and (candidate**2).sum() < cost:
            angles, residual = angles + step, candidate
            cost = (residual**2).sum()
            J = _jacobian(r, angles)
            damping *= 0.1
        elif solved and small:
            return angles, evaluations, True
        else:
            damping *= 10.0
    return angles, evaluations, False


@compiled
def _jacobian(r: FloatArray, angles: FloatArray) -> FloatArray:
    """Derivatives of `r @ vec(E)` by the angles, (5, 9)."""
    J = np.empty((5, 9))
    derivatives = _essential_derivatives(angles)
    for i in range(5):
        J[i] = _times(r, derivatives[i])
    return J


@compiled
def _damped_step(J: FloatArray, residual: FloatArray, damping: float) -> tuple[bool, FloatArray]:
    """Marquardt's step, (5,), and whether there is one."""
    A, step = np.empty((5, 5)), np.empty(5)
    for i in range(5):
        step[i] = -(J[i] * residual).sum()
        for j in range(5):
            A[i, j] = (J[i] * J[j]).sum()
        A[i, i] *= 1.0 + damping
    return solve_positive(A, step), step


@compiled
def _times(r: FloatArray, E: FloatArray) -> FloatArray:
    """`r @ E.ravel()` for an upper triangle (9, 9)."""
    value = np.zeros(9)
    for i in range(9):
        for j in range(i, 9):
            value[i] += r[i, j] * E[j // 3, j % 3]
    return value


@compiled
def _coefficients(rays: FloatArray) -> FloatArray:
    """(9, n): the residuals are `E.ravel() @ _coefficients(rays)`."""
    coefficients = np.ones((9, rays.shape[1]))
    for i in range(3):
        for j in range(3):
            if i < 2:
                coefficients[3 * i + j] *= rays[2 + i]
            if j < 2:
                coefficients[3 * i + j] *= rays[j]
    return coefficients


@compiled
def _essential(angles: FloatArray) -> FloatArray:
    """E of five angles, (3, 3)."""
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    fill_pose(angles, 1.0, R, T)
    fill_essential(R, T, E)
    return E


@compiled
def _essential_derivatives(angles: FloatArray) -> FloatArray:
    """The derivatives of E by the five angles, (5, 3, 3).

    E is a sum of products of sines and cosines of each angle once, and of terms without it. Half
    the difference between a quarter turn ahead and a quarter turn back is the derivative of all of
    them.
    """
    derivatives = np.empty((5, 3, 3))
    for i in range(5):
        ahead, back = angles.copy(), angles.copy()
        ahead[i] += 0.5 * np.pi
        back[i] -= 0.5 * np.pi
        derivatives[i] = 0.5 * (_essential(ahead) - _essential(back))
    return derivatives
