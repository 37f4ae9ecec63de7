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
from scipy.optimize import least_squares

from stereocal.compiled import FloatArray
from stereocal.errors import StereocalError
from stereocal.geometry import Angles, Pose, fill_essential, fill_pose, triangulate_rays

Solver = Literal["constrained", "linear"]
MINIMUM_PAIRS = 5
LINEAR_PAIRS = 8


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
    found = []
    for E in candidates:
        R, t, in_front = choose_pose(E, rays)
        if in_front:
            pose = Pose(R, baseline * t)
            found.append((in_front, _sum_of_squares(pose, rays), pose))
    if not found:
        raise StereocalError(
            "No position of the cameras has the points in front of both. Check that the points of "
            "the two cameras, and the two camera files, are not exchanged."
        )
    cost, pose = _best(found, tie_breaker)
    evaluations = len(candidates)
    if solver == "constrained":
        angles, more, converged = constrain(pose.angles, rays)
        pose = Pose.from_angles(angles, baseline)
        cost = _sum_of_squares(pose, rays)
        evaluations += more
        stop_reason = "converged" if converged else "the largest number of rounds was reached"
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


def _sum_of_squares(pose: Pose, rays: FloatArray) -> float:
    return float(np.sum((_coefficients(rays) @ pose.essential.ravel()) ** 2))


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


def constrain(start: Angles, rays: FloatArray) -> tuple[Angles, int, bool]:
    """Minimise the sum of squared residuals over the five angles.

    A residual is linear in E, so n residuals have the sum of squares of the 9 numbers `r @ vec(E)`,
    where `r` is the triangle of the QR decomposition of their (n, 9) coefficients: a round costs
    the same for 40 pairs and for 40,000.

    Returns the angles, the evaluations, and whether it converged.
    """
    r = np.linalg.qr(_coefficients(rays), mode="r")

    def residual(angles: FloatArray) -> FloatArray:
        value: FloatArray = r @ _essential(angles).ravel()
        return value

    def jacobian(angles: FloatArray) -> FloatArray:
        value: FloatArray = r @ _essential_derivatives(angles).reshape(5, 9).T
        return value

    solution = least_squares(
        residual,
        np.array(start),
        jac=jacobian,
        method="lm",
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    return Angles(*solution.x.tolist()), int(solution.nfev), solution.status > 0


def _coefficients(rays: FloatArray) -> FloatArray:
    """(n, 9): the residuals are `_coefficients(rays) @ E.ravel()`."""
    p = np.vstack([rays[:2], np.ones(rays.shape[1])])
    q = np.vstack([rays[2:], np.ones(rays.shape[1])])
    coefficients: FloatArray = np.einsum("in,jn->nij", q, p).reshape(-1, 9)
    return coefficients


def _essential(angles: FloatArray) -> FloatArray:
    """E of five angles, (3, 3)."""
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    fill_pose(angles, 1.0, R, T)
    fill_essential(R, T, E)
    return E


def _essential_derivatives(angles: FloatArray) -> FloatArray:
    """The derivatives of E by the five angles, (5, 3, 3).

    E is a sum of products of sines and cosines of each angle once, and of terms without it. Half
    the difference between a quarter turn ahead and a quarter turn back is the derivative of all of
    them.
    """
    quarter = np.diag(np.full(5, np.pi / 2))
    return np.array([(_essential(angles + q) - _essential(angles - q)) / 2 for q in quarter])
