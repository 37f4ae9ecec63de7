"""Pairs fused into a rig, without their points.

A pair brings its pose, its lenses and what its images tell of them: normal equations about its own
values, without its priors. Each pair enters as this quadratic, each prior once. Points that several
pairs share are counted once for each pair, so that stated errors are too small (rms of errors over
stated ones 1.11 with 3 cameras, 1.33 with 4); the joint adjustment, which starts here, counts them
once.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial.transform import Rotation

from stereocal.network.fit import RigSettings, lens_places, unknowns_of_rig
from stereocal.refined import views
from stereocal.refined.refine import RefinedResult
from stereocal.refined.robust import turned
from stereocal.refined.two_views import (
    BAR,
    BASELINE,
    TIME,
    pose_of,
    shared_lens_places,
    shared_unknowns,
    unknowns_of_views,
)
from stereocal.refined.unknowns import Unknowns
from stereocal.refined.views import EACH, LENS, TRANSLATION
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray

PLACES = [*shared_lens_places(0), *shared_lens_places(1), BAR, TIME]
"""Of both lenses, the factor and the lateness among the pair's shared unknowns."""
MOST_STEPS = 30
CONVERGED = 1e-6
"""Predicted change of the cost."""
LOCAL = 24
"""Unknowns of a pair here: rotation, translation, 8 of each lens, factor of lengths, lateness."""


@dataclass(frozen=True, eq=False)
class PairFit:
    """A pair's refined set, and what its images say of it."""

    pair: CameraPair
    q: FloatArray
    """(25,): the pair's shared unknowns, as of `two_views`."""
    information: FloatArray
    """(25, 25): of images and lengths, without priors."""
    gradient: FloatArray
    """(25,): half the derivative of their cost at q, where only the priors hold it."""
    noise_px: float
    frames: int

    @classmethod
    def of(cls, pair: CameraPair, fit: RefinedResult) -> "PairFit":
        """From a refined set; frames that follow each other count for less."""
        H, g = fit.images_alone
        q, used = fit.q.copy(), int((~fit.outlying).sum())
        if fit.dataset.time_offset is not None:
            q[TIME] += fit.dataset.time_offset.frames  # by which the points have been shifted
        return cls(pair, q, H, g, float(fit.sigma_px.value), used)

    @cached_property
    def pose(self) -> Pose:
        """`second_from_first`."""
        return pose_of(self.q)

    @cached_property
    def local(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Values (18,), information (24, 24) and gradient (24,) by the rotation of the second
        camera about its own axes, T, the lenses, the factor of lengths, and the lateness.

        The values are those of the lenses, the factor, and the lateness.
        """
        J = local_derivatives(self.q)
        return self.q[PLACES], J.T @ self.information @ J, J.T @ self.gradient


def local_derivatives(q: FloatArray) -> FloatArray:
    """(25, 24): derivatives of a pair's shared unknowns by the local ones."""
    of_pose = unknowns_of_views(q)[2][: BASELINE + 1, EACH : EACH + LENS]
    J = np.zeros((len(q), LOCAL))
    J[: BASELINE + 1, :LENS] = np.linalg.inv(of_pose.T)
    J[PLACES, range(6, LOCAL)] = 1.0
    return J


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


def fuse(recording: Recording, pairs: Sequence[PairFit], settings: RigSettings) -> Fused:
    """Fuse pairs, which must reach all cameras of a recording; the best first."""
    numbers = {name: number for number, name in enumerate(recording.cameras)}
    poses = chained(list(numbers), pairs)
    unknowns = unknowns_of_rig(recording, poses, settings)
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
            _, A, b = fit.local
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
    """The rig's values for a pair less the pair's own, (24,), and their derivatives (24, Q)."""
    values, _, _ = pair.local
    a, b = EACH * first, EACH * second
    R_pair = R[second] @ R[first].T
    T = q[b + 3 : b + 6] - R_pair @ q[a + 3 : a + 6]
    turn = Rotation.from_matrix(R_pair @ pair.pose.R.T).as_rotvec()
    lens = [*lens_places(first), *lens_places(second), len(q) - 1]
    offset = q[b + views.TIME] - q[a + views.TIME]
    d = np.concatenate([turn, T - pair.pose.T, q[lens] - values[:-1], [offset - values[-1]]])
    return d, pair_derivatives(first, second, q, R)


def pair_derivatives(first: int, second: int, q: FloatArray, R: FloatArray) -> FloatArray:
    """(24, Q): derivatives of a pair's local unknowns by those of the rig."""
    a, b, J = EACH * first, EACH * second, np.zeros((LOCAL, len(q)))
    R_pair = R[second] @ R[first].T
    lens = [*lens_places(first), *lens_places(second), len(q) - 1]
    J[:3, b : b + 3], J[:3, a : a + 3] = np.eye(3), -R_pair
    # T turns with R_pair: dT = dT_b - R_pair dT_a - (w_b - R_pair w_a) x (R_pair T_a)
    arm = np.cross(R_pair @ q[a + 3 : a + 6], np.eye(3)).T
    J[3:6, b : b + 3], J[3:6, a : a + 3] = arm, -arm @ R_pair
    J[3:6, b + 3 : b + 6], J[3:6, a + 3 : a + 6] = np.eye(3), -R_pair
    J[range(6, LOCAL - 1), lens] = 1.0
    J[LOCAL - 1, b + views.TIME], J[LOCAL - 1, a + views.TIME] = 1.0, -1.0
    return J


def pair_covariance(
    rig: Rig, first: int, second: int, q: FloatArray, R: FloatArray, covariance: FloatArray
) -> FloatArray:
    """(25, 25): of a pair's shared unknowns, from that of the rig (Q, Q)."""
    J = local_derivatives(shared_unknowns(rig)) @ pair_derivatives(first, second, q, R)
    return np.asarray(J @ covariance @ J.T)
