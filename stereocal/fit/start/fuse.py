"""Pairs fused into a rig, without their points.

A pair brings its pose, its lenses and what its images tell of them: normal equations about its own
values, without its priors. Each pair enters as this quadratic, each prior once. Points that several
pairs share are counted once for each pair, so that stated errors are too small (rms of errors over
stated ones 1.11 with 3 cameras, 1.33 with 4); the joint adjustment, which starts here, counts them
once.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from stereocal.fit.least_squares.small_steps import (
    FACTOR,
    OF_PAIR,
    OF_PAIR_BEHIND_WINDOWS,
    lens_places,
    pose_at,
    pose_places,
    step_between,
    turned,
    window_at,
    window_places,
)
from stereocal.fit.least_squares.unknowns import RefineSettings, Unknowns, unknowns_of
from stereocal.fit.least_squares.views import EACH, LENS, TIME, TRANSLATION, Cameras
from stereocal.fit.least_squares.windows import MEDIUM, OF_WINDOW
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.window import Window
from stereocal.system.array_types import FloatArray

MOST_STEPS = 30
CONVERGED = 1e-6
"""Predicted change of the cost."""


@dataclass(frozen=True, eq=False)
class PairFit:
    """A pair's refined set, and what its images say of it."""

    pair: CameraPair
    at: Cameras
    """Both cameras, the second as late as they are apart."""
    information: FloatArray
    """(33, 33): of images and lengths, without priors."""
    gradient: FloatArray
    """(33,): half the derivative of their cost, where only the priors hold it."""
    noise_px: float
    frames: int
    windows: Mapping[str, Window] = field(default_factory=dict)
    """As each camera sees its own. `information` is without what they leave uncertain."""

    @classmethod
    def of(cls, pair: CameraPair, fit: RefinedResult) -> "PairFit":
        """From a refined set; frames that follow each other count for less."""
        H, g = fit.images_alone
        q, used = fit.at.q.copy(), int((~fit.outlying).sum())
        if fit.dataset.time_offset is not None:
            q[EACH + TIME] += fit.dataset.time_offset.frames  # by which the points were shifted
        seen = {name: window_at(fit.at, number) for number, name in enumerate(pair)}
        windows = {name: window for name, window in seen.items() if window is not None}
        if windows:
            q, (H, g) = np.append(q[: 2 * EACH], q[FACTOR]), _without_windows(fit, H, g)
        at = Cameras(q, fit.at.R, fit.at.lenses)
        return cls(pair, at, H, g, float(fit.sigma_px.value), used, windows)

    @property
    def pose(self) -> Pose:
        """`second_from_first`."""
        return pose_at(self.at)


def _without_windows(
    fit: RefinedResult, H: FloatArray, g: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The normal equations (33, 33) and (33,) of a pair after its windows are eliminated."""
    of_windows = fit.unknowns.M[2 * EACH : FACTOR].any(axis=0)
    others = np.delete(np.eye(len(H)), np.s_[2 * EACH : len(H) - 1], axis=1)
    B = np.hstack([others, fit.unknowns.M[:, of_windows]])
    A, b, n = B.T @ H @ B, B.T @ g, others.shape[1]
    V = A[n:, n:] + fit.unknowns.precision[np.ix_(of_windows, of_windows)]
    gain = np.linalg.solve(V, A[n:, :n]).T
    return A[:n, :n] - gain @ A[n:, :n], b[:n] - gain @ b[n:]


@dataclass(frozen=True, eq=False)
class Fused:
    """A rig of fused pairs."""

    unknowns: Unknowns
    p: FloatArray
    poses: list[Pose]
    information: FloatArray
    """(Q, Q)."""
    misfits: dict[CameraPair, float]
    """By how much the chi-square of each pair grew by being fused."""

    @property
    def q(self) -> FloatArray:
        """(Q,): as of `views`; the rotations are in the poses."""
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)


def chained(cameras: Sequence[str], pairs: Iterable[PairFit]) -> list[Pose]:
    """`camera_from_first` of the cameras, by a chain of pairs.

    Args:
        cameras: names, all reached by `pairs`.
        pairs: the best first.
    """
    poses, grew = {cameras[0]: Pose(np.eye(3), np.zeros(3))}, True
    while grew:
        grew = False
        for fit in pairs:
            first, second = fit.pair
            if first in poses and second not in poses:
                poses[second], grew = fit.pose @ poses[first], True
            elif second in poses and first not in poses:
                poses[first], grew = fit.pose.inverse() @ poses[second], True
            if grew:
                break
    return [poses[name] for name in cameras]


def fuse(recording: Recording, pairs: Sequence[PairFit], settings: RefineSettings) -> Fused:
    """Fuse pairs, which must reach all cameras of a recording; the best first. Windows are left to
    the joint fit."""
    recording = replace(recording, windows=())
    numbers = {name: number for number, name in enumerate(recording.cameras)}
    poses = chained(list(numbers), pairs)
    unknowns = unknowns_of(recording, poses, settings)
    R = np.array([pose.R for pose in poses])
    M, p = unknowns.M, np.zeros(len(unknowns.names))
    # Rotations are in R after a step, and the factor of lengths begins each step at its origin.
    at_origin = M[np.arange(len(M)) % EACH < TRANSLATION].any(axis=0)
    misfits: dict[CameraPair, float] = {}
    H = np.zeros((len(M), len(M)))
    for _ in range(MOST_STEPS):
        q, H, g = unknowns.origin + M @ p, np.zeros((len(M), len(M))), np.zeros(len(M))
        for fit in pairs:
            first, second = (numbers[name] for name in fit.pair)
            d, J = difference(fit, first, second, q, R)
            A, b = fit.information, fit.gradient
            misfits[fit.pair] = float(d @ A @ d + 2 * b @ d)
            H += J.T @ A @ J
            g += J.T @ (A @ d + b)
        b = M.T @ g + unknowns.precision @ p
        step = -unknowns.covariance(H) @ b
        if not np.isfinite(step).all():
            raise np.linalg.LinAlgError("the pairs leave a camera free")
        moved = p + step
        R, p = turned(R, M @ moved), np.where(at_origin, 0.0, moved)
        if -float(step @ b) < CONVERGED:
            break
    T = (unknowns.origin + M @ p)[:-1].reshape(-1, EACH)[:, TRANSLATION:LENS]
    return Fused(unknowns, p, list(map(Pose, R, T)), H, misfits)


def difference(
    pair: PairFit, first: int, second: int, q: FloatArray, R: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """The step from a pair to where the rig has it, (33,), and its derivatives (33, Q)."""
    d = step_between(pair_at(first, second, q, R, pair.at.lenses), pair.at)
    J = pair_derivatives(first, second, q, R)
    return np.where(J.any(axis=1), d, 0.0), J


def pair_at(first: int, second: int, q: FloatArray, R: FloatArray, lenses: FloatArray) -> Cameras:
    """Two cameras of a rig, the first of which is their reference; without what is held of their
    windows."""
    q_pair, (a, b) = np.zeros(_size_of_pair(first, second, q, R)), (EACH * first, EACH * second)
    R_pair = R[second] @ R[first].T
    q_pair[pose_places(1)][TRANSLATION:] = q[b + 3 : b + 6] - R_pair @ q[a + 3 : a + 6]
    for number, camera in enumerate((first, second)):
        q_pair[lens_places(number)] = q[lens_places(camera)]
        if len(q_pair) > OF_PAIR:
            q_pair[window_places(number, 2)] = q[window_places(camera, len(R))]
    q_pair[EACH + TIME], q_pair[FACTOR] = q[b + TIME] - q[a + TIME], q[FACTOR]
    return Cameras(q_pair, np.array([np.eye(3), R_pair]), lenses)


def pair_derivatives(first: int, second: int, q: FloatArray, R: FloatArray) -> FloatArray:
    """(33, Q), with windows (43, Q): derivatives of the unknowns of a pair by those of the rig."""
    a, b, J = EACH * first, EACH * second, np.zeros((_size_of_pair(first, second, q, R), len(q)))
    R_pair, of_pose = R[second] @ R[first].T, J[pose_places(1)]
    of_pose[:3, b : b + 3], of_pose[:3, a : a + 3] = np.eye(3), -R_pair
    # T turns with R_pair: dT = dT_b - R_pair dT_a - (w_b - R_pair w_a) x (R_pair T_a)
    arm = np.cross(R_pair @ q[a + 3 : a + 6], np.eye(3)).T
    of_pose[3:, b : b + 3], of_pose[3:, a : a + 3] = arm, -arm @ R_pair
    of_pose[3:, b + 3 : b + 6], of_pose[3:, a + 3 : a + 6] = np.eye(3), -R_pair
    for number, camera in enumerate((first, second)):
        J[lens_places(number), lens_places(camera)] = 1.0
        if len(J) > OF_PAIR:
            J[window_places(number, 2), window_places(camera, len(R))] = np.eye(OF_WINDOW)
    J[FACTOR, FACTOR] = 1.0
    J[EACH + TIME, b + TIME], J[EACH + TIME, a + TIME] = 1.0, -1.0
    return J


def pair_covariance(
    first: int, second: int, q: FloatArray, R: FloatArray, covariance: FloatArray
) -> FloatArray:
    """(33, 33), with windows (43, 43): of a pair's unknowns, from that of the rig (Q, Q)."""
    J = pair_derivatives(first, second, q, R)
    return np.asarray(J @ covariance @ J.T)


def _size_of_pair(first: int, second: int, q: FloatArray, R: FloatArray) -> int:
    """How many unknowns a pair has of a rig with these; the index of no window is 0."""
    if len(q) == EACH * len(R) + 1:
        return OF_PAIR
    indices = [q[window_places(number, len(R))][MEDIUM] for number in (first, second)]
    return OF_PAIR_BEHIND_WINDOWS if any(indices) else OF_PAIR
