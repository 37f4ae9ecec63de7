"""Method 1, the essential matrix (paper, Section 3.1), with the scale of the measured baseline.

`solver="linear"`: the normalised 8-point estimate (Hartley), projected to an essential matrix, as
in the textbooks; the five-point estimate if there are fewer than 8 pairs. `solver="constrained"`
starts there and minimises the sum of squared residuals over the five angles, so that the "two
constraints" of the paper's footnote 1 hold exactly.
"""

import itertools
from collections.abc import Callable
from typing import Literal

import cv2
import numpy as np

from stereocal.calibration.montecarlo import MethodResult
from stereocal.errors import StereocalError
from stereocal.rig.compiled import FloatArray, clock, compiled, internal
from stereocal.rig.decompositions import is_finite, solve_positive, triangle
from stereocal.rig.geometry import Angles, Pose, fill_essential, fill_pose, midpoint
from stereocal.system.numbers import count

Solver = Literal["constrained", "linear"]
MINIMUM_PAIRS = 5
LINEAR_PAIRS = 8
MAXIMUM_EVALUATIONS = 200
SMALLEST_STEP = 1e-7
"""rad. If a smaller step does not lower the cost, the difference is rounding."""


def calibrate_essential(
    rays: FloatArray,
    baseline: float,
    solver: Solver = "constrained",
    tie_breaker: Callable[[Pose], float] | None = None,
    start: Pose | None = None,
) -> MethodResult:
    """The pose of the rig from pairs of normalised points.

    Args:
        rays: (4, n), as in `geometry`; n >= 5.
        baseline: measured distance between the cameras, in metres.
        tie_breaker: a cost that selects among poses that fit equally well: five pairs fit up to ten
            essential matrices exactly.
        start: initial pose, instead of the 8-point or 5-point estimate.
    """
    started = clock()
    pairs = rays.shape[1]
    if pairs < MINIMUM_PAIRS:
        raise StereocalError(
            f"There {'is' if pairs == 1 else 'are'} {count(pairs, 'pair')} of points; at least "
            f"{MINIMUM_PAIRS} are needed."
        )
    if start is not None:
        candidates = [start.essential]
        stop_reason = "the initial pose was kept"
    elif pairs >= LINEAR_PAIRS:
        candidates = [linear_essential(rays)]
        stop_reason = "solved in one step (8-point)"
    else:
        candidates = _five_point(rays)
        stop_reason = "solved in one step (5-point)"
    if not candidates or not all(np.isfinite(E).all() for E in candidates):
        raise StereocalError(
            "The points do not determine the pose of the cameras: they are too close together or "
            "in a degenerate arrangement. Move the bar through the whole view and the depth."
        )
    found, coefficients = [], _residual_coefficients(rays)
    for E in candidates:
        R, t, in_front = choose_pose(E, rays)
        if in_front:
            pose = Pose(R, t)
            found.append((in_front, _sum_of_squares(pose, coefficients), pose))
    if not found:
        raise StereocalError(
            "No pose of the cameras has the points in front of both. Check that the points of "
            "the two cameras, and the two camera files, are not exchanged."
        )
    # Solved with a baseline of 1, so that the angles do not depend on the measured length.
    cost, pose = _best(found, baseline, tie_breaker)
    evaluations = len(candidates)
    if solver == "constrained":
        angles, more, converged = constrain(np.array(pose.angles), rays)
        pose = Pose.from_angles(Angles(*angles.tolist()), 1.0)
        cost = _sum_of_squares(pose, coefficients)
        evaluations += more
        stop_reason = "converged" if converged else "the largest number of evaluations was reached"
    pose = Pose(pose.R, baseline * pose.T)
    return MethodResult(pose, cost, evaluations, stop_reason, clock() - started)


def _best(
    candidates: list[tuple[int, float, Pose]],
    baseline: float,
    tie_breaker: Callable[[Pose], float] | None,
) -> tuple[float, Pose]:
    """Cost and pose with the most points in front, then with the least cost.

    `tie_breaker` selects among exact fits.
    """
    most = max(in_front for in_front, _, _ in candidates)
    remaining = [(cost, pose) for in_front, cost, pose in candidates if in_front == most]
    least = min(cost for cost, _ in remaining)
    # The residuals of an exact fit are rounding errors: 1e-15 each for rays of order 1.
    ties = [(cost, pose) for cost, pose in remaining if cost <= max(least, 1e-24)]
    if len(ties) > 1 and tie_breaker is not None:
        return min(
            ties,
            key=lambda tie: np.nan_to_num(
                tie_breaker(Pose(tie[1].R, baseline * tie[1].T)), nan=np.inf
            ),
        )
    return min(ties, key=lambda tie: tie[0])


def _sum_of_squares(pose: Pose, coefficients: FloatArray) -> float:
    return float(np.sum((pose.essential.ravel() @ coefficients) ** 2))


def _residual_coefficients(rays: FloatArray) -> FloatArray:
    """(9, n): the residuals are `E.ravel() @ _residual_coefficients(rays)`."""
    p, q = np.ones((3, rays.shape[1])), np.ones((3, rays.shape[1]))
    p[:2], q[:2] = rays[:2], rays[2:]
    return (q[:, None] * p).reshape(9, -1)


def _five_point(rays: FloatArray) -> list[FloatArray]:
    """Essential matrices of all subsets of 5 pairs (Nister's solver, from OpenCV).

    Empty if the pairs give fewer than 5 independent equations, such as one pair repeated.
    """
    singular = np.linalg.svd(_residual_coefficients(rays), compute_uv=False)
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

    NaN if the points do not determine it.
    """
    normalised, middle, scale = np.empty(rays.shape), np.zeros(4), np.empty(4)
    _normalise(rays, normalised, middle, scale)
    r, E = triangle(_coefficients(normalised)), np.full((3, 3), np.nan)
    if not is_finite(r):
        return E
    _, singular, vt = np.linalg.svd(r)
    if singular[7] < 1e-12 * singular[0]:
        return E
    # Undo the normalisation: F = N_secondary^T G N_primary.
    F = np.empty((3, 3))
    for i in range(3):
        for j in range(2):
            F[i, j] = scale[j] * vt[8, 3 * i + j]
        F[i, 2] = vt[8, 3 * i + 2] - middle[0] * F[i, 0] - middle[1] * F[i, 1]
    for j in range(3):
        F[0, j] *= scale[2]
        F[1, j] *= scale[3]
        F[2, j] -= middle[2] * F[0, j] + middle[3] * F[1, j]
    u, singular, vt = np.linalg.svd(F)
    if singular[1] < 1e-12 * singular[0]:
        return E
    for i in range(3):
        for j in range(3):
            E[i, j] = u[i, 0] * vt[0, j] + u[i, 1] * vt[1, j]
    return E


@internal
def _normalise(
    rays: FloatArray, normalised: FloatArray, middle: FloatArray, scale: FloatArray
) -> None:
    """Write `scale * (rays - middle)`: mean 0, and mean square 1 along each axis of a camera."""
    n = rays.shape[1]
    for camera in range(2):
        square = 0.0
        for row in range(2 * camera, 2 * camera + 2):
            for k in range(n):
                middle[row] += rays[row, k] / n
            for k in range(n):
                square += (rays[row, k] - middle[row]) ** 2
        for row in range(2 * camera, 2 * camera + 2):
            scale[row] = 1.0 / np.sqrt(0.5 * square / n)
            for k in range(n):
                normalised[row, k] = scale[row] * (rays[row, k] - middle[row])


@compiled
def choose_pose(E: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """The one of E's four poses with the most points in front of both cameras.

    Returns R (3, 3), the unit vector t (3,), and the number of points in front.
    """
    u, _, vt = np.linalg.svd(E)
    for i in range(3):  # the third vectors as cross products: both matrices are right-handed
        j, k = (i + 1) % 3, (i + 2) % 3
        u[i, 2] = u[j, 0] * u[k, 1] - u[k, 0] * u[j, 1]
        vt[2, i] = vt[0, j] * vt[1, k] - vt[0, k] * vt[1, j]
    R, t, best, most = np.empty((3, 3)), np.empty(3), 0, -1
    for pose in range(5):  # the four, and the best of them again
        fill_candidate(u, vt, pose if pose < 4 else best, R, t)
        in_front = 0
        for k in range(rays.shape[1]):
            z = midpoint(R, t, rays[0, k], rays[1, k], rays[2, k], rays[3, k])[2]
            in_front += 0 if np.isnan(z) else 1
        if in_front > most:
            best, most = pose, in_front
    return R, t, most


@internal
def fill_candidate(
    u: FloatArray, vt: FloatArray, number: int, R: FloatArray, t: FloatArray
) -> None:
    """Write one of the four poses of an essential matrix `u diag(1, 1, 0) vt`."""
    turn, sign = 1.0 - (number & 2), 1.0 - 2.0 * (number & 1)
    for i in range(3):
        t[i] = sign * u[i, 2]
        for j in range(3):
            R[i, j] = turn * (u[i, 1] * vt[0, j] - u[i, 0] * vt[1, j]) + u[i, 2] * vt[2, j]


@compiled
def constrain(start: FloatArray, rays: FloatArray) -> tuple[FloatArray, int, bool]:
    """Minimise the sum of squared residuals over the five angles (Levenberg-Marquardt).

    The residuals are linear in E. Their sum of squares is that of the 9 numbers `r @ vec(E)`, where
    `r` is the upper triangle of the QR decomposition of the (n, 9) coefficients. An iteration
    therefore takes as long for 40,000 pairs as for 40.

    Args:
        start: (5,), the initial angles in radians.
        rays: (4, n).

    Returns:
        The angles (5,), the number of evaluations, and whether the minimisation converged.
    """
    r = triangle(_coefficients(rays))
    angles, trial, step = start.copy(), start.copy(), np.empty(5)
    errors, tried, J, A = np.empty(9), np.empty(9), np.empty((5, 9)), np.empty((5, 5))
    cost, damping, evaluations = _fill_errors(r, angles, errors), 1e-4, 1
    _fill_jacobian(r, angles, J)
    while evaluations < MAXIMUM_EVALUATIONS and damping < 1e12:
        for i in range(5):
            step[i] = 0.0
            for k in range(9):
                step[i] -= J[i, k] * errors[k]
            for j in range(5):
                A[i, j] = 0.0
                for k in range(9):
                    A[i, j] += J[i, k] * J[j, k]
            A[i, i] *= 1.0 + damping
        solved = solve_positive(A, step)
        largest = 0.0
        for i in range(5):
            trial[i] = angles[i] + step[i]
            largest = max(largest, abs(step[i]))
        found = _fill_errors(r, trial, tried)
        evaluations += 1
        if solved and found < cost:
            angles, trial, errors, tried, cost = trial, angles, tried, errors, found
            _fill_jacobian(r, angles, J)
            damping *= 0.1
        elif solved and largest < SMALLEST_STEP:
            return angles, evaluations, True
        else:
            damping *= 10.0
    return angles, evaluations, False


@internal
def _fill_jacobian(r: FloatArray, angles: FloatArray, J: FloatArray) -> None:
    """Write the derivatives of the 9 errors by the five angles, (5, 9).

    As a function of one angle a, each entry of E has the form A sin(a) + B cos(a) + C. Its exact
    derivative is half the difference between its values at a + pi/2 and a - pi/2.
    """
    turned, ahead, back = angles.copy(), np.empty(9), np.empty(9)
    for i in range(5):
        turned[i] = angles[i] + 0.5 * np.pi
        _fill_errors(r, turned, ahead)
        turned[i] = angles[i] - 0.5 * np.pi
        _fill_errors(r, turned, back)
        turned[i] = angles[i]
        for k in range(9):
            J[i, k] = 0.5 * (ahead[k] - back[k])


@internal
def _fill_errors(r: FloatArray, angles: FloatArray, errors: FloatArray) -> float:
    """Write the errors `r @ E.ravel()` (9,) of an upper triangle r; return their sum of squares."""
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    fill_pose(angles, 1.0, R, T)
    fill_essential(R, T, E)
    square = 0.0
    for i in range(9):
        errors[i] = 0.0
        for j in range(i, 9):
            errors[i] += r[i, j] * E[j // 3, j % 3]
        square += errors[i] * errors[i]
    return square


@internal
def _coefficients(rays: FloatArray) -> FloatArray:
    """As `_residual_coefficients`, in compiled code."""
    coefficients = np.empty((9, rays.shape[1]))
    for k in range(rays.shape[1]):
        for i in range(3):
            row = rays[2 + i, k] if i < 2 else 1.0
            for j in range(3):
                coefficients[3 * i + j, k] = row * (rays[j, k] if j < 2 else 1.0)
    return coefficients
