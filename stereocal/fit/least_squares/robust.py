"""The robust fit of the refined method: outlying frames, noise, final least squares.

The loss of a frame is Tukey's biweight of its chi-square, with a limit that is lowered in steps
(graduated non-convexity; Yang et al., IEEE RA-L 2020). Frames beyond the final limit are left out,
and the others are adjusted by plain least squares. Noise that is not given is estimated between
the rounds.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.linalg.lapack import dposv

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.adjustment import (
    add_baselines,
    equations_for,
    length_innovations,
    sum_normal_equations,
)
from stereocal.fit.least_squares.noise import (
    ASSUMED,
    ESTIMATED,
    GIVEN,
    frame_limits,
    limits_of,
    lower_third,
    scatter_of,
    thirds_of,
    unit_freedom,
)
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.small_steps import pose_at, poses_in, step_between, turned
from stereocal.fit.least_squares.unknowns import (
    RefineSettings,
    Unknowns,
    inverse_of,
    length_sigma,
    measured_baselines,
    unknowns_of,
)
from stereocal.fit.least_squares.views import EACH, LENS, OWN, TRANSLATION, Cameras, Units
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.system.array_types import BoolArray, FloatArray, IntArray

ASSUMED_PX = 0.5
MINIMUM_PAIRS = 10
"""Pairs needed to estimate the noise: the five angles leave five degrees of freedom."""
MINIMUM_BARS = 5
BIWEIGHT_LIMIT = 2.0
"""End of the biweight in units of the limit: a typical frame keeps 0.86 of its weight."""
SMALLEST_SIGMA_PX = 1e-3
"""Lower bound of the estimated noise."""
SMALLEST_SCATTER = 1e-5
"""Lower bound of the estimated scatter, as a fraction of the bar."""
MAXIMUM_ROUNDS = 8
TOLERANCE = 1e-9
"""A solve ends when a step is predicted to lower the cost by less: 3e-5 standard errors."""
UNTAKEN = 1e-3
"""Of the tolerance: steps that are predicted to gain less are not taken."""
ROUGH_TOLERANCE = 1e-2
"""The same while the limit is still being lowered: a tenth of a standard error."""
ROUGH_STEPS = 15
"""At most so many then; those that end well need 2 to 5."""
LARGEST_SCATTER = 1.0
"""Of the lengths, in units of the longest, after a solve that did not converge and let it grow: the
fit has given them up, and its scale drifts without end (four fifths of the time where depths are
reversed)."""
FIRST_DAMPING, EASED, RAISED, LEAST_RAISED = 1e-5, 0.05, 20.0, 1e-4
"""Marquardt's damping of a solve: at first; its factors after a step that lowers the cost and after
one that does not; and its least value then. Nearly undamped at first, since poses begin near: 20
steps for sample_data/field, 40 for the recording, 397 for every eighth frame of ewand123. A quarter
and four times each number: 18 to 23, 36 to 43, 365 to 432 steps, and the same answers (to 1.5e-5 in
any unknown, of ewand123 to 1e-6 standard errors). Where field begins up to 0.55 rad off, 10 starts
of 10 come to the same fit in 2940 steps, or 2738 to 3206."""
ROUNDING = 1e-6
"""A step that is predicted to gain less, and gains nothing, ends the solve: what is left is
rounding and the remaining error of the points. (2.5e-7 and 4e-6: the same steps, but 4 of 2940.)"""
LOWERED = 0.25
"""Factor of the biweight's limit from one solve of the annealing to the next. The noise comes from
the same third of the frames as the first limit, so that one solve is nearly always enough: with
0.06 and 0.7 the rigs above, and field with 11 of 25 frames wrong, take the same steps."""
ROUGHLY_SAME_NOISE, OF_SMALLEST_SCATTER = 0.1, 0.1
"""Relative change of the noise that ends the annealing, and change of the scatter over
`SMALLEST_SCATTER`. With 0.4 of the first, ewand123 takes 358 steps and 103 solves instead of 397
and 116, with 0.025 413 and 129; its answers change by 1e-6 standard errors."""
SAME_NOISE = 0.01
"""Relative change of the noise in a round, below which it has converged."""


def about_first(turns: FloatArray, H: FloatArray, g: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Normal equations (Q, Q) and (Q,) by the rotation vectors of the cameras about their first
    rotations, instead of about the present ones.

    To first order exp(w + d) = exp(L d) exp(w), with the Jacobian of SO(3) from the left (Sola et
    al. 2018, arXiv:1812.01537, appendix B). With a = |w| and [u]x v = u x v, u = w / a:

        L = 1 + (1 - cos a) / a [u]x + (1 - sin(a) / a) [u]x [u]x.

    Args:
        turns: (c, 3): where these vectors are.
    """
    if not turns.any():
        return H, g
    L = np.eye(len(g))
    for number, w in enumerate(turns):
        a, rotation = float(np.linalg.norm(w)), slice(EACH * number, EACH * number + TRANSLATION)
        if a > 0.0:
            ux = np.cross(w / a, np.eye(3)).T
            L[rotation, rotation] += (1 - np.cos(a)) / a * ux + (1 - np.sin(a) / a) * ux @ ux
    return L.T @ H @ L, L.T @ g


class RobustFit:
    """A robust fit of frames that N cameras see."""

    def __init__(
        self,
        seen: Observations,
        unknowns: Unknowns,
        settings: RefineSettings,
        R: FloatArray,
        baselines: FloatArray,
    ) -> None:
        """A fit before its first step.

        Args:
            R: (c, 3, 3): the first rotations.
            baselines: (m, 4): as in `adjustment.add_baselines`.
        """
        self.seen, self.unknowns, self.settings = seen, unknowns, settings
        self.frames, self.frame_of = seen.frames, seen.frame_of
        self.begin = Cameras(unknowns.origin, R, seen.lenses, seen.windows)
        self.baselines = baselines
        self.p = np.zeros(len(unknowns.names))
        places = np.arange(EACH * len(R))
        self.of_poses = np.asarray(unknowns.M[places[places % EACH < LENS]].any(axis=0))
        # Poses without priors are taken from the present ones, and `begin` goes with them.
        self.goes_along = self.of_poses & np.isinf(unknowns.sigma)
        self.free: BoolArray = np.asarray(unknowns.M.any(axis=1))
        known, of_pixels = np.isfinite(seen.distances), unit_freedom(seen.pixels)
        self.unit_freedom = of_pixels + known
        self.pixel_freedom = self.by_frame(of_pixels).astype(np.int64)
        self.degrees_of_freedom = self.by_frame(self.unit_freedom).astype(np.int64)
        self.set_limits(len(unknowns.names))
        images = np.isfinite(seen.pixels[..., 0]).sum()
        enough = images // 2 >= MINIMUM_PAIRS, known.sum() >= MINIMUM_BARS
        self.smallest_scatter = SMALLEST_SCATTER * seen.length_m
        self.sigma_px = settings.sigma_px or ASSUMED_PX
        self.scatter = max(settings.scatter_m or 0.0, self.smallest_scatter)
        self.source_px, self.source_scatter = (
            GIVEN if value is not None else ESTIMATED if known else ASSUMED
            for value, known in zip((settings.sigma_px, settings.scatter_m), enough, strict=True)
        )
        # Points and chi-squares (n,) of the units, chi-squares (f,) of the frames, and the normal
        # equations (Q, Q) of q without priors.
        self.points = np.full((len(seen.pixels), OWN), np.nan)
        self.of_units = np.full(len(seen.pixels), np.inf)
        self.chi_squares = np.full(len(self.frames), np.inf)
        self.H = np.zeros((len(unknowns.origin),) * 2)
        self.outlying = np.zeros(len(self.frames), dtype=np.bool_)
        self.is_near = False
        self.cost, self.steps, self.converged = np.inf, 0, False
        self.begun: tuple[Cameras, FloatArray, BoolArray] | None = None

    @classmethod
    def of(
        cls,
        recording: Recording,
        poses: Sequence[Pose],
        settings: RefineSettings,
        rows: BoolArray | None = None,
    ) -> "RobustFit":
        """The fit of a recording from first poses.

        Args:
            poses: `camera_from_reference` of each camera.
            rows: mask (n,) of the points to fit; all if None.
        """
        moving = settings.time_offset or settings.time_drift
        seen = Observations.of(recording, moving, rows)
        baselines = measured_baselines(recording, settings)
        unknowns = unknowns_of(recording, poses, settings, seen.has_lengths)
        has_length = seen.has_lengths and np.isfinite(length_sigma(recording, settings)[0])
        if not (len(baselines) or has_length):
            raise StereocalError(
                "Nothing fixes the scale: give the baseline or the bar a finite uncertainty."
            )
        return cls(seen, unknowns, settings, np.array([pose.R for pose in poses]), baselines)

    def set_limits(self, unknowns: int) -> None:
        """Set the chi-squares above which frames (f,) are outliers, for a number of unknowns, and
        the shares (n,) of their units in them."""
        self.limit = frame_limits(self.unit_freedom, self.frame_of, unknowns)
        of_units = limits_of(self.unit_freedom, unknowns)
        self.share_of_limit = of_units / self.limit[self.frame_of]

    def start_at(self, known: Mapping[str, float], sigma_px: float) -> None:
        """Start where another fit ended, as far as it has the same free parameters.

        Those of the poses stay 0: the first poses are the other fit's.
        """
        values = np.array([known.get(name, 0.0) for name in self.unknowns.names])
        self.p = np.where(self.of_poses, 0.0, values)
        self.sigma_px = sigma_px if self.source_px == ESTIMATED else self.sigma_px

    def start_near(self, known: Mapping[str, float], sigma_px: float, scatter_m: float) -> bool:
        """Start where a fit of nearly the same frames ended; False if none of them fits there."""
        self.start_at(known, sigma_px)
        if self.source_scatter == ESTIMATED:
            self.scatter = scatter_m
        self.evaluate(self.limit)
        self.outlying = ~(self.chi_squares <= self.limit)
        self.is_near = self.settings.loss == "robust" and not self.outlying.all()
        return self.is_near

    def take(self, p: FloatArray, sigma_px: float, scatter_m: float) -> "RobustFit":
        """Take the free parameters p (k,) and the noise of another fit."""
        self.p, self.sigma_px, self.scatter = p, sigma_px, scatter_m
        return self

    def explained(self) -> BoolArray:
        """(f,): which frames the present parameters and noise explain."""
        self.evaluate(np.zeros(len(self.frames)))
        return np.asarray(self.chi_squares <= self.limit)

    def better_than(self, other: "RobustFit") -> bool:
        """Whether images, lengths and priors fit better here, both with the smaller noise."""
        noise = min(self.sigma_px, other.sigma_px), min(self.scatter, other.scatter)
        here, there = (
            np.minimum(fit.chi_squares_with(fit, *noise), fit.limit).sum() + fit.prior_cost
            for fit in (self, other)
        )
        return bool(here < there)

    @property
    def used(self) -> IntArray:
        """Indices of the frames that were not left out."""
        return np.flatnonzero(~self.outlying)

    @property
    def q(self) -> FloatArray:
        """(Q,): the unknowns, from `begin`."""
        return np.asarray(self.begin.q + self.unknowns.M @ self.p)

    @property
    def at(self) -> Cameras:
        """The cameras at the present parameters, with the stated distortion."""
        return self._placed(self.p)[2]

    @property
    def poses(self) -> list[Pose]:
        """`camera_from_reference` of each camera."""
        cameras = self.at
        return [pose_at(cameras, number) for number in range(len(cameras.R))]

    @property
    def recording(self) -> Recording:
        """What is fitted, with the stated cameras."""
        return self.seen.recording

    @property
    def is_determined(self) -> bool:
        """Whether all that was solved for is a number with an error."""
        return bool(np.isfinite(self.q).all()) and self.at_end.determined(self.H)

    def _measured(self) -> tuple[FloatArray, FloatArray, float]:
        """Normal equations (Q, Q) and (Q,) of the measured baselines, and their cost."""
        cameras = self.at
        H, g = np.zeros((len(cameras.q),) * 2), np.zeros(len(cameras.q))
        return H, g, add_baselines(self.baselines, cameras.q, cameras.R, H, g)

    @property
    def prior_cost(self) -> float:
        """The cost of priors and measured baselines."""
        return self._measured()[2] + float(self.p @ self.unknowns.precision @ self.p)

    @property
    def prior_gradient(self) -> FloatArray:
        """(k,): half the derivative of `prior_cost` by the free parameters."""
        return np.asarray(
            self.unknowns.M.T @ self._measured()[1] + self.unknowns.precision @ self.p
        )

    @property
    def at_end(self) -> Unknowns:
        """The unknowns, from `begin`, with the measured baselines, linear where they are, among
        their priors."""
        M = self.unknowns.M
        precision = self.unknowns.precision + M.T @ self._measured()[0] @ M
        return replace(self.unknowns, origin=self.begin.q, precision=precision)

    def by_frame(self, of_units: npt.ArrayLike) -> FloatArray:
        """(f,): sums over the units of each frame."""
        return np.bincount(self.frame_of, of_units, len(self.frames)).astype(np.float64)

    def _units(self, length_weight: float, which: IntArray | slice = slice(None)) -> Units:
        """What was measured of some units."""
        seen = self.seen
        motion = seen.motion[which] if len(seen.motion) else seen.motion
        pixels, rays, distances = seen.pixels[which], seen.rays[which], seen.distances[which]
        return Units(pixels, rays, motion, distances, 1 / self.sigma_px, length_weight)

    def _solve(
        self, limits: FloatArray, tolerance: float = TOLERANCE, most: float = np.inf
    ) -> None:
        """Minimise the cost with these limits (f,) of the loss, by Levenberg and Marquardt in at
        most so many steps; updates all results.

        The cost of the free parameters p (k,) is sum_n rho(s_n) + baselines + p^T precision p, s_n
        being the chi-square of unit n with its points fitted. With the normal equations H and g of
        q = begin + M p, weighted by rho', a step d solves

            (A + damping diag(A)) d = b,   A = M^T H M + precision,   b = M^T g + precision p,

        and goes to p - d (Marquardt 1963, J. Soc. Indust. Appl. Math. 11, 431). b^T d, the `gain`,
        is the decrease that the quadratic model predicts and, where it is small, the square of the
        step in standard errors. A step that raises the cost is not taken: A and b stay, and the
        damping grows.
        """
        precision, units = self.unknowns.precision, self._units(1 / self.scatter)
        limits, into = limits[self.frame_of] * self.share_of_limit, equations_for(self.free)
        points, of_units, p = self.points.copy(), self.of_units.copy(), self.p
        gain, damping, self.cost, self.converged = np.inf, FIRST_DAMPING, np.inf, False
        M = self.unknowns.M
        for step in range(int(min(most, self.settings.maximum_steps)) + 1):
            p, begin, cameras = self._placed(p)
            total = sum_normal_equations(cameras, units, limits, points, of_units, into)
            H, g = into.H.copy(), into.g
            total += add_baselines(self.baselines, cameras.q, cameras.R, H, g)
            total += float(p @ precision @ p)
            if total <= self.cost or step == 0:
                self.cost, self.p, self.begin = total, p, begin
                turns = self._turns
                self.points[:], self.of_units[:] = points, of_units
                self.H[:], _ = about_first(turns, into.H, into.g)
                self.converged = gain < tolerance
                damping *= EASED if step > 0 else 1.0
                H, g = about_first(turns, H, g)
                A, b = M.T @ H @ M + precision, M.T @ g + precision @ p
            else:
                self.converged = gain < ROUNDING
                points[:] = self.points
                damping = max(RAISED * damping, LEAST_RAISED)
            if self.converged:
                break
            damped = A.copy()
            damped.flat[:: len(b) + 1] *= 1.0 + damping
            _, d, failed = dposv(damped, b)
            gain = float(b @ d)  # the predicted decrease
            if failed or not gain >= 0.0:  # A is not positive definite, or NaN
                step += 1
                break
            if gain < UNTAKEN * tolerance:
                self.converged = True
                break
            p = self.p - d
        self.chi_squares[:] = self.by_frame(self.of_units)
        self.steps += step

    def _placed(self, p: FloatArray) -> tuple[FloatArray, Cameras, Cameras]:
        """The free parameters p (k,), what they are from, and the cameras there. Poses without
        priors go along: their free parameters are 0 then."""
        begin, q = self.begin, self.begin.q + self.unknowns.M @ p
        R = turned(begin.R, q)
        poses_in(q, len(R))[:, :TRANSLATION] = 0.0
        cameras = begin._replace(q=q, R=R)
        if self.goes_along.any():
            from_here = begin.q.copy()
            poses_in(from_here, len(R))[:] = poses_in(q, len(R))
            p, begin = np.where(self.goes_along, 0.0, p), cameras._replace(q=from_here)
        return p, begin, cameras

    @property
    def _turns(self) -> FloatArray:
        """(c, 3): the small rotations from `begin`."""
        return poses_in(self.unknowns.M @ self.p, len(self.begin.R))[:, :TRANSLATION]

    def sum_at(
        self,
        length_weight: float,
        limits: FloatArray,
        points: FloatArray,
        chi_squares: FloatArray,
        units: IntArray | slice = slice(None),
        free: BoolArray | None = None,
    ) -> tuple[float, FloatArray, FloatArray]:
        """Cost, H (Q, Q) and g (Q,) at the present parameters, as of
        `adjustment.sum_normal_equations`.

        Args:
            limits, points, chi_squares: of the units.
            free: (Q,): None for those that are not held fixed.
        """
        measured = self._units(length_weight, units)
        into = equations_for(self.free if free is None else free)
        cost = sum_normal_equations(self.at, measured, limits, points, chi_squares, into)
        return cost, *about_first(self._turns, into.H, into.g)

    def chi_squares_with(
        self, other: "RobustFit", sigma_px: float | None = None, scatter_m: float | None = None
    ) -> FloatArray:
        """(f,): of these frames with the cameras of another fit, and the noise of this one if none
        is given."""
        cameras, of_units = other.at, np.empty(len(self.points))
        measured = self._units(1 / (scatter_m or self.scatter))
        measured = measured._replace(weight=1 / (sigma_px or self.sigma_px))
        points, into = np.full(self.points.shape, np.nan), equations_for(np.zeros_like(self.free))
        sum_normal_equations(cameras, measured, np.zeros(len(points)), points, of_units, into)
        return self.by_frame(of_units)

    def innovations(self, points: FloatArray) -> FloatArray:
        """(n, 2): as of `adjustment.length_innovations`."""
        innovations = np.empty((len(points), 2))
        length_innovations(self.at, self._units(1.0), points, innovations)
        return innovations

    def equations(self, groups: Sequence[IntArray]) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Normal equations of groups of frames, given by their indices, where the fit is.

        They are 0 for an empty group, and for one with a point behind a camera.

        Returns:
            H (g, Q, Q), J r (g, Q), and the costs (g,).
        """
        every, sums = np.ones(len(self.free), dtype=np.bool_), []
        for group in groups:
            units = np.flatnonzero(np.isin(self.frame_of, group)) if self.seen.has_parts else group
            n = len(units)
            limits, points, chi_squares = np.full(n, np.inf), np.full((n, OWN), np.nan), np.empty(n)
            sums.append(self.sum_at(1 / self.scatter, limits, points, chi_squares, units, every))
        c, H, g = map(np.array, zip(*sums, strict=True))
        lost = ~np.isfinite(c)
        H[lost], g[lost], c[lost] = 0.0, 0.0, 0.0
        return H, g, c

    def evaluate(self, limits: FloatArray) -> None:
        """Points, chi-squares and H at the present parameters."""
        limits = limits[self.frame_of] * self.share_of_limit
        _, self.H[:], _ = self.sum_at(1 / self.scatter, limits, self.points, self.of_units)
        self.chi_squares[:] = self.by_frame(self.of_units)

    def run(self, others: Iterable["RobustFit"] = ()) -> bool:
        """Solve; return False if there is no solution with a frame that fits, or it would be that
        of one of the others."""
        if not self.is_near and not (
            self._anneal() if self.settings.loss == "robust" else self._estimate_noise(True)
        ):
            return False
        if self.settings.loss == "robust":  # else nothing is fitted yet
            if any(map(self._begins_like, others)):
                return False
            self.begun = self.at, self.H.copy(), self.outlying
        for _ in range(MAXIMUM_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            self._solve(np.where(self.outlying, 0.0, np.inf))
            A = self.unknowns.M.T @ self.H @ self.unknowns.M + self.at_end.precision
            if not (np.isfinite(self.cost) and (np.diag(A) >= 0.0).all()):
                return False  # A is rounding alone where a wrong initial pose has diverged
            if not self._estimate_noise():
                return False
            if self.settings.loss == "robust":
                now = self.chi_squares * (before[0] / self.sigma_px) ** 2
                self.outlying = ~(now <= self.limit)
            if self._is_unchanged(before, SAME_NOISE):
                break
        self._solve(np.where(self.outlying, 0.0, np.inf))
        return bool(np.isfinite(self.cost)) and not self.outlying.all()

    def _begins_like(self, other: "RobustFit") -> bool:
        """Whether it is within a standard error of where another fit began, with the same frames
        left out."""
        if other.begun is None:
            return False
        begun, H, outlying = other.begun
        d = step_between(self.at, begun)
        return bool(d @ H @ d < 1.0) and bool((outlying == self.outlying).all())

    def _anneal(self) -> bool:
        """Lower the limit of the biweight in steps; noise from robust scales.

        It begins at the scale of the best third of the frames, so that every second one may be bad,
        and ends at `BIWEIGHT_LIMIT` times the limit of outliers (graduated non-convexity;
        docs/refined.md, *Gross errors*).
        """
        for _ in range(MAXIMUM_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            if not self._estimate_noise(robust=True):
                return False
            self.evaluate(np.zeros(len(self.frames)))  # chi-squares alone
            scale = lower_third(self.chi_squares / thirds_of(self.degrees_of_freedom))
            if not np.isfinite(scale):
                return False
            while True:
                scale = max(1.0, scale)
                self._solve(BIWEIGHT_LIMIT * scale * self.limit, ROUGH_TOLERANCE, ROUGH_STEPS)
                if not np.isfinite(self.cost):
                    return False
                if scale == 1.0:
                    break
                scale *= LOWERED
            if self._is_unchanged(before, ROUGHLY_SAME_NOISE):
                break
        self.outlying = ~(self.chi_squares <= self.limit)
        return bool((~self.outlying).any())

    def _is_unchanged(self, before: tuple[float, float, BoolArray], same: float) -> bool:
        sigma, scatter, outlying = before
        return (
            abs(self.sigma_px - sigma) <= same * sigma
            and abs(self.scatter - scatter)
            <= max(same * scatter, OF_SMALLEST_SCATTER * self.smallest_scatter)
            and bool((outlying == self.outlying).all())
        )

    def _estimate_noise(self, robust: bool = False) -> bool:
        """Estimate sigma_px from the pixel residuals alone, and then the scatter of the lengths.

        Returns False if no frame can be fitted, or none with its length.
        """
        if ESTIMATED not in (self.source_px, self.source_scatter):
            return True
        points, of_units = self.points.copy(), np.empty(len(self.points))
        limits = np.where(self.outlying | robust, 0.0, np.inf)[self.frame_of]
        _, H, _ = self.sum_at(0.0, limits, points, of_units)
        chi_squares = self.by_frame(of_units)
        spent_px, spent_m = (0.0, 0.0) if robust else self._spent(H)
        if self.source_px == ESTIMATED:
            if robust:
                ratio = lower_third(chi_squares / thirds_of(self.pixel_freedom))
            else:
                good = ~self.outlying & np.isfinite(chi_squares)
                left = float(self.pixel_freedom[good].sum()) - spent_px
                left *= float(self.seen.variances[good].mean()) if good.any() else 1.0
                ratio = float(chi_squares[good].sum()) / max(left, 1.0)
            if not np.isfinite(ratio):
                return False
            self.sigma_px = max(self.sigma_px * float(np.sqrt(ratio)), SMALLEST_SIGMA_PX)
        if self.source_scatter == ESTIMATED:
            lengths, before = self.innovations(points), self.scatter
            lengths = lengths[np.isfinite(lengths[:, 0]) & ~self.outlying[self.frame_of]]
            self.scatter = max(
                scatter_of(lengths[:, 0], lengths[:, 1], spent_m, robust), self.smallest_scatter
            )
            lost = self.scatter > max(LARGEST_SCATTER * self.seen.length_m, before)
            return not (lost and self.steps and not self.converged)
        return True

    def _spent(self, of_pixels: FloatArray) -> tuple[float, float]:
        """Degrees of freedom used by the unknowns, of the pixels and of the lengths.

        They are the traces of the two parts of the hat matrix: with C the covariance of the free
        parameters, trace(C H_pixels) and trace(C H_lengths).

        Args:
            of_pixels: (Q, Q): the part of H from the pixels alone.
        """
        M = self.unknowns.M
        pixels, everything = M.T @ of_pixels @ M, M.T @ self.H @ M
        C = inverse_of(everything + self.at_end.precision)
        return float(np.sum(C * pixels)), max(float(np.sum(C * (everything - pixels))), 0.0)
