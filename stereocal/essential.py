"""Method 1, the essential matrix (paper, Section 3.1), with the scale of the measured baseline.

`solver="linear"`: the normalised 8-point estimate (Hartley), projected to an essential matrix, as
the textbooks do; the five-point estimate where there are fewer than 8 pairs. `solver="constrained"`
goes on from there to the minimiser of the sum of squared residuals over the five angles: the
paper's "two constraints" (its footnote 1) hold exactly.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np

from stereocal.compiled import FloatArray, compiled
from stereocal.errors import StereocalError
from stereocal.geometry import (
    Pose,
    angles_of,
    fill_essential,
    fill_pose,
    triangulate_rays,
)

Solver = Literal["constrained", "linear"]
MINIMUM_PAIRS = 5
LINEAR_PAIRS = 8
MAXIMUM_ROUNDS = 100


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
) -> EssentialResult:
    """The pose of the rig from pairs of normalised points.

    Args:
        rays: (4, n), as in `geometry`; n >= 5.
        baseline: measured distance between the cameras, in metres.
        tie_breaker: a cost that tells poses apart which fit equally well. Five pairs fit up to ten
            essential matrices exactly.

    Raises:
        StereocalError: fewer than 5 pairs, or points that determine no pose.
    """
    started = time.perf_counter()
    pairs = rays.shape[1]
    if pairs < MINIMUM_PAIRS:
        raise StereocalError(
            f"There are {pairs} pairs of points; at least {MINIMUM_PAIRS} are needed."
        )
    if pairs >= LINEAR_PAIRS:
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
    evaluations = len(candidates)
    found = []
    for E in candidates:
        R, T, in_front = choose_pose(E, rays)
        if in_front and solver == "constrained":
            angles = np.array(angles_of(R, T))
            rounds, converged = constrain(angles, rays)
            evaluations += rounds
            fill_pose(angles, 1.0, R, T)
            stop_reason = "converged" if converged else "the largest number of rounds was reached"
        if in_front:
            found.append((in_front, _sum_of_squares(R, T, rays), Pose(R, baseline * T)))
    if not found:
        raise StereocalError(
            "No position of the cameras has the points in front of both. Check that the points of "
            "the two cameras, and the two camera files, are not exchanged."
        )
    cost, pose = _best(found, tie_breaker)
    return EssentialResult(
        pose, cost, evaluations, stop_reason, time.perf_counter() - started, solver
    )


def _best(
    found: list[tuple[int, float, Pose]], tie_breaker: Callable[[Pose], float] | None
) -> tuple[float, Pose]:
    """Most points in front, then least residual; exact fits are told apart by `tie_breaker`."""
    most = max(in_front for in_front, _, _ in found)
    left = [(cost, pose) for in_front, cost, pose in found if in_front == most]
    least = min(cost for cost, _ in left)
    # Residuals of an exact fit are rounding: 1e-15 each on rays of order 1.
    ties = [(cost, pose) for cost, pose in left if cost <= max(least, 1e-24)]
    if len(ties) > 1 and tie_breaker is not None:
        return min(ties, key=lambda tie: np.nan_to_num(tie_breaker(tie[1]), nan=np.inf))
    return min(ties, key=lambda tie: tie[0])


def _sum_of_squares(R: FloatArray, T: FloatArray, rays: FloatArray) -> float:
    E = np.empty((3, 3))
    fill_essential(R, T, E)
    p, q = (
        np.vstack([rays[:2], np.ones(rays.shape[1])]),
        np.vstack([rays[2:], np.ones_like(rays[0])]),
    )
    return float(np.sum(np.einsum("in,ij,jn->n", q, E, p) ** 2))


def _five_point(rays: FloatArray) -> list[FloatArray]:
    """Essential matrices of all subsets of 5 pairs (Nister's solver, from OpenCV)."""
    candidates: list[FloatArray] = []
    for subset in itertools.combinations(range(rays.shape[1]), MINIMUM_PAIRS):
        p = np.ascontiguousarray(rays[:2, subset].T)
        q = np.ascontiguousarray(rays[2:, subset].T)
        stacked, _ = cv2.findEssentialMat(p, q, np.eye(3), method=cv2.RANSAC, threshold=1e-3)
        if stacked is not None:
            candidates += list(np.asarray(stacked, dtype=np.float64).reshape(-1, 3, 3))
    return candidates


def linear_essential(rays: FloatArray) -> FloatArray:
    """The 8-point estimate with Hartley's normalisation, projected to an essential matrix (3, 3).

    NaN where the points do not determine it. Plain NumPy: compiled, its decompositions take 13 s to
    compile and save 0.1 ms a call.
    """
    p, normalise_p = _normalised(rays[:2])
    q, normalise_q = _normalised(rays[2:])
    A = np.einsum("in,jn->nij", q, p).reshape(-1, 9)
    if not np.isfinite(A).all():
        return np.full((3, 3), np.nan)
    _, singular, vt = np.linalg.svd(A, full_matrices=len(A) < 9)
    if singular[7] < 1e-12 * singular[0]:
        return np.full((3, 3), np.nan)
    u, _, vt = np.linalg.svd(normalise_q.T @ vt[8].reshape(3, 3) @ normalise_p)
    E: FloatArray = u @ np.diag([1.0, 1.0, 0.0]) @ vt
    return E


def _normalised(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Homogeneous points (3, n) about 0 with a mean square of 1 along each axis, and the map."""
    mean = points.mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / np.sqrt(((points - mean[:, None]) ** 2).mean())
        T = np.array([[scale, 0.0, -scale * mean[0]], [0.0, scale, -scale * mean[1]], [0, 0, 1]])
        return T @ np.vstack([points, np.ones(points.shape[1])]), T


def choose_pose(E: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """The one of E's four poses with the most points in front of both cameras.

    Returns R, the unit vector t, and how many points are in front.
    """
    u, _, vt = np.linalg.svd(E)
    u, vt = u * np.sign(np.linalg.det(u)), vt * np.sign(np.linalg.det(vt))
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    found = []
    for R in (u @ turn @ vt, u @ turn.T @ vt):
        for t in (u[:, 2].copy(), -u[:, 2]):
            points = triangulate_rays(R, t, rays)
            found.append((R, t, int(np.isfinite(points[:, 0]).sum())))
    return max(found, key=lambda pose: pose[2])


@compiled
def constrain(angles: FloatArray, rays: FloatArray) -> tuple[int, bool]:
    """Minimise the sum of squared residuals over the five angles, in place (Levenberg-Marquardt).

    Returns the rounds and whether it converged.
    """
    normal, gradient = np.empty((5, 5)), np.empty(5)
    cost = _normal_equations(angles, rays, normal, gradient)
    damping = 1e-3
    for rounds in range(1, MAXIMUM_ROUNDS + 1):
        damped = normal.copy()
        for i in range(5):
            damped[i, i] += damping * normal[i, i] + 1e-300
        step = np.linalg.solve(damped, -gradient)
        trial = angles + step
        trial_normal, trial_gradient = np.empty((5, 5)), np.empty(5)
        trial_cost = _normal_equations(trial, rays, trial_normal, trial_gradient)
        if trial_cost <= cost:
            angles[:] = trial
            cost, normal, gradient = trial_cost, trial_normal, trial_gradient
            damping = max(damping * 0.1, 1e-15)
        else:
            damping *= 10.0
        # Steps of 1e-12 rad are 1e-8 px at a focal length of 10,000 px.
        if np.abs(step).max() < 1e-12 or damping > 1e12:
            return rounds, True
    return MAXIMUM_ROUNDS, False


@compiled
def _normal_equations(
    angles: FloatArray, rays: FloatArray, normal: FloatArray, gradient: FloatArray
) -> float:
    """J^T J, J^T r and the sum of squares of the residuals at `angles`; J by its exact form."""
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    fill_pose(angles, 1.0, R, T)
    fill_essential(R, T, E)
    derivatives = np.empty((5, 3, 3))
    shifted, moved_R, moved_T = angles.copy(), np.empty((3, 3)), np.empty(3)
    for i in range(3):
        # A quarter turn added to a sine or cosine is its derivative; the rows and columns of R that
        # the angle does not touch cancel in the difference of two quarter turns.
        shifted[i] = angles[i] + 0.5 * np.pi
        fill_pose(shifted, 1.0, moved_R, moved_T)
        forward = moved_R.copy()
        shifted[i] = angles[i] - 0.5 * np.pi
        fill_pose(shifted, 1.0, moved_R, moved_T)
        shifted[i] = angles[i]
        fill_essential(0.5 * (forward - moved_R), T, derivatives[i])
    cd, sd, ce, se = np.cos(angles[3]), np.sin(angles[3]), np.cos(angles[4]), np.sin(angles[4])
    fill_essential(R, np.array([-sd * ce, -sd * se, cd]), derivatives[3])
    fill_essential(R, np.array([-se, ce, 0.0]), derivatives[4])
    derivatives[4] *= cd
    normal[:], gradient[:], total = 0.0, 0.0, 0.0
    row = np.empty(5)
    for k in range(rays.shape[1]):
        p = (rays[0, k], rays[1, k], 1.0)
        q = (rays[2, k], rays[3, k], 1.0)
        value = 0.0
        row[:] = 0.0
        for a in range(3):
            for b in range(3):
                value += q[a] * E[a, b] * p[b]
                for i in range(5):
                    row[i] += q[a] * derivatives[i, a, b] * p[b]
        total += value * value
        for i in range(5):
            gradient[i] += row[i] * value
            for j in range(5):
                normal[i, j] += row[i] * row[j]
    return total
