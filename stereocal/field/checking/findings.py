"""What a check of new images found, by the fits of its hypotheses."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation
from scipy.special import fdtrc, stdtrit

from stereocal.evaluation.summary import Estimate
from stereocal.field.checking import fits
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import Prior
from stereocal.field.checking.since import Since
from stereocal.fit.least_squares.small_steps import baseline_direction, pose_at, rig_of
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray

Verdict = Literal["moved", "same", "cannot tell"]
POSE_LEVEL, FOCAL_LEVEL = 0.009, 0.001
"""Probabilities of a false alarm of the two tests: 1 % together."""
CONSISTENT = 0.05
"""An explanation is possible above this probability."""
AS_LIKELY = 6.0
"""Difference of two explanations' scores below which neither is ruled out: odds of 20 to 1."""
LARGEST_NOISE_RATIO = 5.0
"""Above this multiple of the calibration's noise, the images fit no pose."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """One explanation of new images."""

    moved: bool
    refocused: tuple[CameraName, ...]
    fit: fits.Fit

    @property
    def score(self) -> float:
        """Bayesian information criterion: the cost and a penalty for each value that is free."""
        residuals = self.fit.degrees + len(self.fit.change)
        return float(self.fit.cost + len(self.fit.change) * np.log(max(residuals, 2)))


@dataclass(frozen=True, eq=False)
class Recheck:
    """The answer of a check."""

    prior: Prior
    images: NewImages
    """All new images."""
    after: NewImages
    """Those since the movement; all of them unless it was among them."""
    outlying: BoolArray
    """(f,): the groups of `after` that contradict the others."""
    noise: fits.ImageNoise
    since: Since | None
    """Since when, if it was among these images."""
    pose: fits.Fit
    """Fit of `after` if the pose has changed."""
    both: fits.Fit
    """Fit of `after` if pose and focal lengths have changed."""
    power: fits.Power
    smallest: fits.Smallest
    p_pose: float
    """Probability of such a cost difference by chance, with nothing changed; since a movement, also
    of that of the images after it alone."""
    p_focal: float
    """The same for the focal lengths, beside a change of the pose."""

    @property
    def scale(self) -> bool:
        """Whether lengths are known, so that the baseline is determined."""
        return self.images.bars > 0

    @property
    def usable(self) -> bool:
        """Whether the images fit any pose of these cameras."""
        expected = max(self.prior.sigma_px, self.images.stated_px)
        return self.noise.sigma_px <= LARGEST_NOISE_RATIO * expected

    @cached_property
    def seen(self) -> bool:
        """Whether something has changed, be it ever so small, and the likeliest cause by itself
        explains the images; otherwise none is to be named. The images that the parameters come from
        show no change since: what does not fit there are the lenses."""
        is_likely = self.p_pose < POSE_LEVEL or self.p_focal < FOCAL_LEVEL
        if not (self.usable and is_likely) or self.images.own:
            return False
        cause = self.explanations[0].fit
        gain = self.same.cost - cause.cost
        return self.noise.probability(gain, len(cause.change)) < POSE_LEVEL

    @cached_property
    def negligible(self) -> bool:
        """Whether a change is seen, and is surely smaller than matters. A focal length matters as
        much as the baseline: both are factors of lengths."""
        if not self.seen or not self.turn[0].high < self.smallest.turn_rad:
            return False
        changes = [] if self.baseline_change is None else [self.baseline_change]
        if self.refocused or self.ambiguous:
            sigmas = np.sqrt(np.diag(self.both.change_covariance))[-2:]
            changes += map(self._interval, self.both.d[-2:].tolist(), sigmas.tolist())
        largest = max((max(abs(change.low), abs(change.high)) for change in changes), default=0.0)
        return largest < self.smallest.baseline

    @property
    def changed(self) -> bool:
        """Whether the parameters no longer hold."""
        return self.seen and not self.negligible

    @property
    def verdict(self) -> Verdict:
        if self.changed:
            return "moved"
        would_be_seen = self.usable and self.power.is_enough and not self.images.own
        return "same" if self.negligible or would_be_seen else "cannot tell"

    @cached_property
    def same(self) -> fits.Fit:
        """Fit of `after` if nothing has changed."""
        return self.fit(fits.NOTHING)

    def fit(self, change: fits.Change, start: Pose | None = None) -> fits.Fit:
        """The images since the movement, fitted with this change."""
        fit = fits.Fit(self.prior, self.after, change, self.noise.counted_px)
        return fit.minimise(self.outlying, start)

    @cached_property
    def explanations(self) -> tuple[Explanation, ...]:
        """What may have changed, the likeliest first."""
        explanations = [Explanation(True, (), self.pose), Explanation(True, CAMERAS, self.both)]
        explanations += [Explanation(True, (), fit) for fit in self._turns]
        for k, which in enumerate(CAMERAS):
            focal = fits.focal_change(self.prior, k)
            with_pose = self.fit(self._pose_change + focal, pose_at(self.pose.at))
            explanations.append(Explanation(False, (which,), self.fit(focal)))
            explanations.append(Explanation(True, (which,), with_pose))
        explanations.append(Explanation(False, CAMERAS, self.fit(fits.focal_changes(self.prior))))
        return tuple(sorted(explanations, key=lambda explanation: explanation.score))

    @cached_property
    def _turns(self) -> list[fits.Fit]:
        """Either camera has turned in place."""
        return [self.fit(fits.turn_in_place(pose_at(self.prior.at), k)) for k in (0, 1)]

    @property
    def refocused(self) -> tuple[CameraName, ...]:
        """The cameras whose focal length has changed; empty if none has."""
        return self.explanations[0].refocused if self.seen else ()

    @property
    def pose_moved(self) -> bool:
        """Whether the pose has changed; false if refocused lenses alone explain the images."""
        return self.seen and self.explanations[0].moved

    @cached_property
    def _rivals(self) -> list[Explanation]:
        """The explanations that are nearly as likely as the first."""
        first, *others = self.explanations
        return [rival for rival in others if rival.score - first.score < AS_LIKELY]

    @cached_property
    def ambiguous(self) -> bool:
        """Whether a movement and a refocused lens explain the images about equally well."""
        return self.seen and any(
            (rival.moved, bool(rival.refocused)) != (self.pose_moved, bool(self.refocused))
            and not (rival.moved and rival.refocused)
            for rival in self._rivals
        )

    @cached_property
    def either_lens(self) -> bool:
        """Whether one lens was refocused, and the images cannot tell which."""
        return len(self.refocused) == 1 and any(
            rival.moved == self.pose_moved and len(rival.refocused) == 1 for rival in self._rivals
        )

    @cached_property
    def best(self) -> fits.Fit:
        """The fit whose cameras are the repaired ones; where images cannot tell what has changed,
        all that may have is free."""
        if not self.seen:
            return self.same
        if self.ambiguous:
            return self.both
        if self.either_lens:
            return self.both if self.pose_moved else self.fit(fits.focal_changes(self.prior))
        return self.explanations[0].fit if self.refocused else self.pose

    @cached_property
    def held_out(self) -> fits.RepairErrors:
        """The errors of held-out groups with the old and with repaired parameters."""
        return fits.measured_held_out(self.prior, self.after, self.best)

    @cached_property
    def offers_repair(self) -> bool:
        """Whether the repaired parameters are to be used: not where held-out groups are measured no
        better with them."""
        return self.changed and self.held_out.better

    @property
    def repaired(self) -> Rig:
        return rig_of(self.prior.rig.primary, self.prior.rig.secondary, self.best.at)

    @property
    def _with_pose(self) -> fits.Fit:
        """The fit from which the change of the pose is computed."""
        return self.both if self.refocused or self.ambiguous else self.pose

    @cached_property
    def turn(self) -> tuple[Estimate, FloatArray]:
        """Angle of the relative rotation in radians with its 95 % interval, and its vector (3,) in
        the secondary's axes."""
        fit = self._with_pose
        vector = Rotation.from_matrix(pose_at(fit.at).R @ pose_at(fit.before).R.T).as_rotvec()
        covariance = fit.change_covariance[:3, :3]
        angle = max(float(np.linalg.norm(vector)), 1e-15)
        along = vector / angle
        variance = float(along @ covariance @ along)
        # The length of a noisy vector is too large by the noise across it.
        across = float(np.trace(covariance)) - variance
        value = float(np.sqrt(max(angle**2 - across, 0.0)))
        reach = self._quantile * float(np.sqrt(variance))
        p = float(fdtrc(3, self.noise.degrees, vector @ np.linalg.solve(covariance, vector) / 3))
        low = max(value - reach, 0.0) if p < CONSISTENT else 0.0
        return Estimate(value, low, angle + reach), vector

    @cached_property
    def baseline_m(self) -> Estimate | None:
        """The baseline now, with its 95 % interval; None where lengths are unknown."""
        if not self.scale:
            return None
        fit = self._with_pose
        along = baseline_direction(fit.at)
        sigma = float(np.sqrt(along @ fit.covariance @ along))
        return self._interval(pose_at(fit.at).baseline, sigma)

    @cached_property
    def baseline_change(self) -> Estimate | None:
        """Fraction by which the baseline has changed, with its 95 % interval."""
        if not self.scale:
            return None
        fit = self._with_pose
        change = pose_at(fit.at).baseline / pose_at(fit.before).baseline - 1.0
        return self._interval(change, float(np.sqrt(fit.change_covariance[fits.SCALE, fits.SCALE])))

    @cached_property
    def focal_changes(self) -> Mapping[CameraName, Estimate]:
        """Fraction by which the focal length of each refocused camera has changed."""
        if not self.refocused:
            return {}
        fit, last = self.explanations[0].fit, slice(-len(self.refocused), None)
        sigmas = np.sqrt(np.diag(fit.change_covariance))[last]
        return dict(zip(self.refocused, map(self._interval, fit.d[last], sigmas), strict=True))

    @cached_property
    def possible_causes(self) -> tuple[CameraName, ...]:
        """The cameras whose turn in place alone explains the movement."""
        degrees, cost = len(self._pose_change) - 3, self.pose.cost
        turns = zip(CAMERAS, self._turns, strict=True)
        return tuple(
            which
            for which, turn in turns
            if self.noise.probability(turn.cost - cost, degrees) > CONSISTENT
        )

    @property
    def _pose_change(self) -> fits.Change:
        return fits.pose_change(self.prior, self.scale)

    @property
    def _quantile(self) -> float:
        return float(stdtrit(self.noise.degrees, 0.975))

    def _interval(self, value: float, sigma: float) -> Estimate:
        reach = self._quantile * float(sigma)
        return Estimate(float(value), float(value) - reach, float(value) + reach)
