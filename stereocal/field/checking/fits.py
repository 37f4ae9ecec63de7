"""Fits of new images with the old parameters as prior, and how small a movement they would reveal.

The cameras are a step L p + U d from where the file has them: the old parameters within their
covariance, L p with p normal, and a change d of what U spans. Two hypotheses with nested U are
compared by the difference of their costs, which follows the F distribution if the smaller one is
true. For a known noise it is chi-square, noncentral with d' I d where the larger one is true: I is
the information of the new images about the change d with the old parameters eliminated, their
covariance included.
"""

from dataclasses import dataclass
from itertools import product
from typing import Protocol, Self

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtri, chndtr, chndtrinc, fdtrc

from stereocal.errors import StereocalError
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import Prior
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import (
    OF_PAIR,
    baseline_direction,
    lens_places,
    moved,
    pose_places,
    rig_at,
    rig_of,
    step_between,
)
from stereocal.fit.least_squares.unknowns import RefineSettings, Unknowns
from stereocal.fit.least_squares.views import TRANSLATION, Cameras
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray

WIDE_ANGLE, WIDE_FOCAL, WIDE_BASELINE = 0.3, 0.1, 0.2
"""Standard deviations of a change: radians, and fractions. They only keep finite what the images do
not determine."""
SCALE = 5
"""The place of the baseline, as a factor, in a change of the pose: after two times a direction."""
FOLDS = 5
"""Runs of neighbouring groups, each held out once: neighbours share their errors."""
CLEARLY = 0.5
"""Where the errors in the images fall to this fraction, the repaired parameters are better though
lengths are not: a turn about the baseline's normal hardly changes any."""
NOT_WORSE = 1.2
"""Factor by which length errors may grow then, by chance."""


LEVEL = 0.01
"""False alarms."""
ENOUGH = 0.8
AXES = np.array([v for v in product((-1, 0, 1), repeat=3) if v > (0, 0, 0)], dtype=np.float64)
"""13 directions, evenly spread over all axes."""


@dataclass(frozen=True, eq=False)
class Change:
    """What may have changed: the directions U of a hypothesis."""

    directions: FloatArray
    """(33, m)."""
    sigma: FloatArray
    """(m,)."""

    def __len__(self) -> int:
        return len(self.sigma)

    def __add__(self, other: "Change") -> "Change":
        return Change(
            np.column_stack([self.directions, other.directions]),
            np.concatenate([self.sigma, other.sigma]),
        )


class CamerasKnown(Protocol):
    """Cameras by their parameters: normal, a step root N(0, 1) from where they are."""

    @property
    def at(self) -> Cameras: ...

    @property
    def root(self) -> FloatArray:
        """(Q, r)."""


NOTHING = Change(np.zeros((OF_PAIR, 0)), np.zeros(0))


def pose_change(prior: Prior, scale: bool) -> Change:
    """The pose: a turn of the secondary camera about its own axes, the direction of the baseline
    across two axes, all in radians, and, if `scale`, the baseline as a factor."""
    along, pose = baseline_direction(prior.at), pose_places(1)
    T, t = prior.at.q[pose][TRANSLATION:], along[pose][TRANSLATION:]
    directions = np.zeros((OF_PAIR, SCALE + 1))
    directions[pose, :TRANSLATION] = np.eye(2 * TRANSLATION)[:, :TRANSLATION]
    of_T = directions[pose][TRANSLATION:]
    of_T[:, TRANSLATION:SCALE] = np.linalg.norm(T) * np.linalg.svd(t[None])[2][1:].T
    of_T[:, SCALE] = T
    sigma = np.append(np.full(SCALE, WIDE_ANGLE), WIDE_BASELINE)
    count = SCALE + scale
    return Change(directions[:, :count], sigma[:count])


def focal_change(prior: Prior, camera: int) -> Change:
    """The focal length of the primary (0) or the secondary (1), as a factor of both fx and fy."""
    direction, places = np.zeros((OF_PAIR, 1)), lens_places(camera)[:2]
    direction[places, 0] = prior.at.q[places]
    return Change(direction, np.full(1, WIDE_FOCAL))


def focal_changes(prior: Prior) -> Change:
    """The focal lengths of both cameras."""
    return focal_change(prior, 0) + focal_change(prior, 1)


def turn_in_place(pose: Pose, camera: int) -> Change:
    """A turn of the primary (0) or the secondary (1) about its own centre, rotation vector in its
    own axes, in radians."""
    # x' = D x of the secondary turns R and T; of the primary, R D^T = (R D^T R^T) R.
    directions = np.zeros((OF_PAIR, 3))
    of_pose = directions[pose_places(1)]
    of_pose[:TRANSLATION] = np.eye(3) if camera else -pose.R
    of_pose[TRANSLATION:] = np.cross(np.eye(3), pose.T).T * camera
    return Change(directions, np.full(3, WIDE_ANGLE))


class PriorFit(RobustFit):
    """One hypothesis: old parameters as prior, what may have changed, and new images."""

    def __init__(
        self, seen: Observations, prior: CamerasKnown, change: Change, settings: RefineSettings
    ) -> None:
        known = prior.root.shape[1]
        unknowns = Unknowns(
            names=tuple(f"value {i}" for i in range(known + len(change))),
            origin=prior.at.q,
            M=np.ascontiguousarray(np.column_stack([prior.root, change.directions])),
            sigma=np.concatenate([np.ones(known), change.sigma]),
            precision=block_diag(np.eye(known), np.diag(1.0 / change.sigma**2)),
        )
        super().__init__(seen, unknowns, settings, prior.at.R, np.empty((0, 4)))
        self.root, self.change, self.known = prior.root, change, known

    def fit_all_but(self, outlying: BoolArray) -> Self:
        """Fit all groups but the outlying ones, by plain least squares."""
        self.outlying = outlying
        self._solve(np.where(outlying, 0.0, np.inf))
        return self

    @property
    def degrees(self) -> int:
        """Degrees of freedom of the cost."""
        return int(self.degrees_of_freedom[~self.outlying].sum()) - len(self.change)

    @property
    def d(self) -> FloatArray:
        """(m,): the change."""
        return self.p[self.known :]

    @property
    def change_covariance(self) -> FloatArray:
        """(m, m): covariance of the change."""
        return np.asarray(self.unknowns.covariance(self.H)[self.known :, self.known :])


class Fit(PriorFit):
    """One hypothesis of two cameras."""

    def __init__(self, prior: Prior, images: NewImages, change: Change, sigma_px: float) -> None:
        settings = RefineSettings(sigma_px=sigma_px, scatter_m=prior.scatter_m)
        super().__init__(Observations.of(images.dataset.recording), prior, change, settings)
        self.prior, self.images = prior, images
        self.set_limits(len(change) - round(prior.degrees))

    def start_from(self, pose: Pose) -> None:
        """Start with the pose changed to this one; the change must begin with the pose."""
        old = self.prior.rig
        step = step_between(rig_at(Rig(old.primary, old.secondary, pose)), rig_at(old))
        of_pose = slice(self.known, self.known + min(len(self.change), SCALE + 1))
        self.p[:] = 0.0
        self.p[of_pose] = np.linalg.lstsq(self.unknowns.M[:, of_pose], step, rcond=None)[0]
        self.points[:] = np.nan

    def minimise(self, outlying: BoolArray, start: Pose | None = None) -> "Fit":
        """Fit all groups but the outlying ones, by plain least squares, from a pose if stated."""
        if start is not None:
            self.start_from(start)
        return self.fit_all_but(outlying)

    @property
    def before(self) -> Cameras:
        """The cameras before the change, by these images too."""
        return moved(self.prior.at, self.prior.root @ self.p[: self.known])

    @property
    def covariance(self) -> FloatArray:
        """(33, 33): covariance of the unknowns of `views` after the change."""
        M = self.unknowns.M
        return np.asarray(M @ self.unknowns.covariance(self.H) @ M.T)


@dataclass(frozen=True, eq=False)
class ImageNoise:
    """The noise of new images, and the groups that contradict the others."""

    sigma_px: float
    degrees: float
    """Degrees of freedom behind it, with those of the file unless the noise has changed."""
    as_before: bool
    """Whether it agrees with the file's noise."""
    outlying: BoolArray
    """(f,)."""
    design_effect: float = 1.0
    """Variance over that with independent groups."""
    least_effect: float = 1.0
    """By what neighbours lack of the file's noise."""

    @property
    def counted_px(self) -> float:
        """The noise with which independent groups would have the same information."""
        return self.sigma_px * float(np.sqrt(self.design_effect))

    def probability(self, gain: float, degrees: int) -> float:
        """p-value of this cost difference, for hypotheses that differ by `degrees` values."""
        return float(fdtrc(degrees, self.degrees, max(gain, 0.0) / degrees))


@dataclass(frozen=True)
class RepairErrors:
    """Mean errors of groups that were held out, before and after the repair."""

    px: tuple[float, float]
    length: tuple[float, float] | None
    """Length errors, |reconstructed - stated| / stated; None without bars."""

    @property
    def better(self) -> bool:
        """Whether the repaired parameters measure them better."""
        before, after = self.px
        if self.length is None:
            return after < before
        was, now = self.length
        return now < was or (after < CLEARLY * before and now < NOT_WORSE * was)


def measured_held_out(prior: Prior, images: NewImages, best: Fit) -> RepairErrors:
    """The errors of each run of groups with the old parameters, and repaired by the other runs.

    Groups that are outlying in `best`, the fit of all of them, are not used. If fewer than two are
    left, nothing is better.
    """
    groups = np.flatnonzero(~best.outlying)
    errors = []
    if len(groups) < 2:
        return RepairErrors((0.0, 0.0), None)
    for held in np.array_split(groups, min(FOLDS, len(groups))):
        fit = Fit(prior, images, best.change, best.sigma_px)
        fit.p[:] = best.p
        fit.points[:] = np.nan
        outlying = best.outlying.copy()
        outlying[held] = True
        cameras, old = fit.minimise(outlying).at, prior.rig
        part, repaired = images.of_groups(held), rig_of(old.primary, old.secondary, cameras)
        errors.append(np.stack([part.errors_with(old), part.errors_with(repaired)], axis=1))
    every_error = np.concatenate(errors, axis=2)
    known = np.isfinite(every_error[1]).any(axis=1).all()
    # With the old parameters no point may meet in front of the cameras, after a turn of 17 degrees.
    is_seen = np.isfinite(every_error).any(axis=2, keepdims=True)
    errors_or_infinite = np.where(is_seen, every_error, np.inf)
    (px, new_px), *lengths = np.nanmean(errors_or_infinite[: 2 if known else 1], axis=2).tolist()
    return RepairErrors((px, new_px), (lengths[0][0], lengths[0][1]) if known else None)


@dataclass(frozen=True)
class Smallest:
    """The smallest movement that matters."""

    turn_rad: float = float(np.radians(0.05))
    baseline: float = 0.001
    """Fraction of the baseline."""

    def __post_init__(self) -> None:
        if not (self.turn_rad > 0.0 and self.baseline > 0.0):
            raise StereocalError("The smallest turn and change of the baseline must be above 0.")

    @classmethod
    def of(cls, turn_deg: float | None = None, baseline: float | None = None) -> "Smallest":
        """The movement of these sizes; None: the usual size."""
        turn_rad = cls.turn_rad if turn_deg is None else float(np.radians(turn_deg))
        return cls(turn_rad, cls.baseline if baseline is None else baseline)

    @property
    def turn_deg(self) -> float:
        return float(np.degrees(self.turn_rad))


@dataclass(frozen=True)
class Power:
    """What new images would reveal."""

    turn: float
    """Probability that the smallest turn of interest is found, about the worst axis."""
    turn_anywhere: float
    """The same about an axis at random."""
    baseline: float | None
    """Probability that the smallest change of the baseline is found; None without lengths."""
    detectable_turn_rad: float
    """Turn about the worst axis that is found with a probability of 80 %."""
    detectable_baseline: float | None
    """Fraction of the baseline, likewise."""

    @property
    def is_enough(self) -> bool:
        return self.turn >= ENOUGH and (self.baseline is None or self.baseline >= ENOUGH)


def information_of(fit: PriorFit, change: Change | None = None) -> FloatArray:
    """(m, m): information I of the images of a fit about its change d, or about another one that it
    leaves free, old parameters eliminated.

    With the information H of the images and the root L of the old parameters' covariance, it is
    U'HU - U'HL (L'HL + 1)^-1 L'HU: the 1 is the prior of p (docs/check.md, "How").
    """
    root, U = fit.root, (change or fit.change).directions
    across = U.T @ fit.H @ root
    known = root.T @ fit.H @ root + np.eye(root.shape[1])
    return np.asarray(U.T @ fit.H @ U - across @ np.linalg.solve(known, across.T))


def power_of(information: FloatArray, change: FloatArray) -> float:
    """Probability that a change d (m,) is found, for a known noise, with `LEVEL` false alarms: the
    cost difference is noncentral chi-square with d' I d (docs/check.md, "How")."""
    degrees = len(change)
    noncentrality = float(change @ information @ change)
    return float(1.0 - chndtr(chdtri(degrees, LEVEL), degrees, noncentrality))


def power(fit: Fit, smallest: Smallest) -> Power:
    """The power of new images, by their fit of the pose, with lengths that of the baseline too."""
    pose, information, m = fit.prior.rig.pose, information_of(fit), len(fit.change)
    coefficients = np.linalg.pinv(fit.change.directions)
    # The noncentrality that is found with a probability of 80 %.
    needed = float(chndtrinc(chdtri(m, LEVEL), m, 1.0 - ENOUGH))

    def factor(change: FloatArray) -> float:  # by which it must be larger
        return float(np.sqrt(needed / max(float(change @ information @ change), 1e-300)))

    # One camera turned in place, about 13 axes each.
    axes = smallest.turn_rad * AXES / np.linalg.norm(AXES, axis=1, keepdims=True)
    turns = [
        coefficients @ turn_in_place(pose, camera).directions @ axis
        for camera in (0, 1)
        for axis in axes
    ]
    powers = [power_of(information, turn) for turn in turns]
    longer, lengths = smallest.baseline * np.eye(m)[-1], m > SCALE
    return Power(
        min(powers),
        float(np.mean(powers)),
        power_of(information, longer) if lengths else None,
        min(smallest.turn_rad * max(map(factor, turns)), float(np.pi)),
        smallest.baseline * factor(longer) if lengths else None,
    )
