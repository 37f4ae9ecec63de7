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
from scipy.optimize import leastsq

from stereocal.calibration.montecarlo import MethodResult
from stereocal.errors import StereocalError
from stereocal.rig.compiled import clock
from stereocal.rig.geometry import Angles, Pose, fill_essential, fill_pose, triangulate_rays
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import count

Solver = Literal["constrained", "linear"]
MINIMUM_PAIRS = 5
LINEAR_PAIRS = 8
MAXIMUM_EVALUATIONS = 200
TOLERANCE = 1e-14
"""The tolerance of step, cost and gradient: below it, the difference is rounding."""
_CONVERGED = 1, 2, 3, 4
"""What `leastsq` calls an end within its tolerances."""
_UNDETERMINED = np.full((3, 3), np.nan)
_QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
_ALONG = np.diag([0.0, 0.0, 1.0])
_CROSS_PRODUCTS = np.cross(np.eye(3)[:, None], np.eye(3)).transpose(0, 2, 1).reshape(3, 9)
"""`v @ _CROSS_PRODUCTS` are the entries of `[v]x`."""


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
    poses, coefficients = [], _residual_coefficients(rays)
    for E in candidates:
        R, t, in_front = choose_pose(E, rays)
        if in_front:
            pose = Pose(R, t)
            poses.append((in_front, _sum_of_squares(pose, coefficients), pose))
    if not poses:
        raise StereocalError(
            "No pose of the cameras has the points in front of both. Check that the points of "
            "the two cameras, and the two camera files, are not exchanged."
        )
    # Solved with a baseline of 1, so that the angles do not depend on the measured length.
    cost, pose = _best(poses, baseline, tie_breaker)
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


def linear_essential(rays: FloatArray) -> FloatArray:
    """The 8-point estimate with Hartley's normalisation, projected to an essential matrix (3, 3).

    NaN if the points do not determine it.
    """
    if not np.isfinite(rays).all():
        return _UNDETERMINED
    # Mean 0, and mean square 1 along each axis of a camera.
    middle = rays.mean(axis=1)
    centred = rays - middle[:, None]
    spread = np.repeat(np.sqrt((centred**2).reshape(2, -1).mean(axis=1)), 2)
    if not spread.all():
        return _UNDETERMINED
    r = _triangle(centred / spread[:, None])
    _, singular, vt = np.linalg.svd(r)
    if singular[7] < 1e-12 * singular[0]:
        return _UNDETERMINED
    primary, secondary = np.diag([*1.0 / spread[:2], 1.0]), np.diag([*1.0 / spread[2:], 1.0])
    primary[:2, 2], secondary[:2, 2] = (-middle / spread).reshape(2, 2)
    u, singular, vt = np.linalg.svd(secondary.T @ vt[8].reshape(3, 3) @ primary)
    return _UNDETERMINED if singular[1] < 1e-12 * singular[0] else u[:, :2] @ vt[:2]


def choose_pose(E: FloatArray, rays: FloatArray) -> tuple[FloatArray, FloatArray, int]:
    """The one of E's four poses with the most points in front of both cameras.

    Returns R (3, 3), the unit vector t (3,), and the number of points in front.
    """
    poses = _poses(E)
    in_front = [
        int(np.count_nonzero(np.isfinite(triangulate_rays(R, t, rays)[:, 2]))) for R, t in poses
    ]
    best = int(np.argmax(in_front))
    return *poses[best], in_front[best]


def _poses(E: FloatArray) -> list[tuple[FloatArray, FloatArray]]:
    """The four poses (R, t) of an essential matrix `u diag(1, 1, 0) vt`."""
    u, _, vt = np.linalg.svd(E)
    # The third vectors as cross products: both matrices are right-handed.
    u[:, 2], vt[2] = np.cross(u[:, 0], u[:, 1]), np.cross(vt[0], vt[1])
    turns = [sign * _QUARTER_TURN + _ALONG for sign in (1.0, -1.0)]
    return [(u @ turn @ vt, sign * u[:, 2]) for turn in turns for sign in (1.0, -1.0)]


def constrain(start: FloatArray, rays: FloatArray) -> tuple[FloatArray, int, bool]:
    """Minimise the sum of squared residuals over the five angles (Levenberg-Marquardt).

    The residual of a pair is `q_secondary^T E q_primary` (paper, eq. 3): `constrained` of method 1
    in docs/method.md, where it is said why the squares are summed.

    The residuals are linear in E. Their sum of squares is that of the 9 numbers `r @ vec(E)`, where
    `r` is the upper triangle of the QR decomposition of the (n, 9) coefficients. An iteration
    therefore takes as long for 40,000 pairs as for 40.

    Args:
        start: (5,), the initial angles in radians.
        rays: (4, n), n >= 5.

    Returns:
        The angles (5,), the number of evaluations, and whether the minimisation converged.
    """
    r = _triangle(rays)

    def errors(angles: FloatArray) -> FloatArray:
        return np.asarray(r @ _essential(angles))

    def slopes(angles: FloatArray) -> FloatArray:
        return np.asarray(r @ essential_slopes(angles))

    # `least_squares` does the same in twice the time: what it adds around each evaluation.
    solution, _, info, _, status = leastsq(
        errors,
        start,
        Dfun=slopes,
        full_output=True,
        maxfev=MAXIMUM_EVALUATIONS,
        xtol=TOLERANCE,
        ftol=TOLERANCE,
        gtol=TOLERANCE,
    )
    return np.asarray(solution), int(info["nfev"]), status in _CONVERGED


def essential_slopes(angles: FloatArray) -> FloatArray:
    """The derivatives of vec(E) by the five angles, (9, 5).

    Of `R = Ry Rx Rz` the derivatives by its angles are `[y]x R`, `[Ry x]x R` and `R [z]x`; those of
    t are at right angles to it.
    """
    R, T = np.empty((3, 3)), np.empty(3)
    fill_pose(angles, 1.0, R, T)
    sin_y, _, _, sin_d, sin_t = np.sin(angles).tolist()
    cos_y, _, _, cos_d, cos_t = np.cos(angles).tolist()
    vectors = (
        (0.0, 1.0, 0.0),
        (cos_y, 0.0, -sin_y),
        (-sin_d * cos_t, -sin_d * sin_t, cos_d),
        (-cos_d * sin_t, cos_d * cos_t, 0.0),
        (cos_d * cos_t, cos_d * sin_t, sin_d),
    )
    of_y, of_x, of_d, of_t, t = (np.array(vectors) @ _CROSS_PRODUCTS).reshape(5, 3, 3)
    E, slopes = t @ R, np.empty((5, 3, 3))
    slopes[0], slopes[1], slopes[3], slopes[4] = t @ of_y @ R, t @ of_x @ R, of_d @ R, of_t @ R
    slopes[2, :, 0], slopes[2, :, 1], slopes[2, :, 2] = E[:, 1], -E[:, 0], 0.0
    return slopes.reshape(5, 9).T


def _essential(angles: FloatArray) -> FloatArray:
    """(9,): the entries of E at five angles."""
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    fill_pose(angles, 1.0, R, T)
    fill_essential(R, T, E)
    return E.ravel()


def _triangle(rays: FloatArray) -> FloatArray:
    """(min(n, 9), 9): r with `r.T @ r = C @ C.T`, C of `_residual_coefficients`."""
    return np.asarray(np.linalg.qr(_residual_coefficients(rays).T, mode="r"))
