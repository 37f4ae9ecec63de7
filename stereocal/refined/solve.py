"""The solve of the refined method: robust fit, outlying frames, noise, final least squares.

The loss of a frame is Tukey's biweight of its chi-square, with a limit that is lowered in steps
(graduated non-convexity; Yang et al., IEEE RA-L 2020). Frames beyond the final limit are left out,
and the others are adjusted by plain least squares. Noise that is not given is estimated between
the rounds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri, fdtri

from stereocal.refined.adjustment import (
    ROUGH_TOLERANCE,
    TOLERANCE,
    adjust,
    excess_variance,
    length_innovations,
    sum_normal_equations,
)
from stereocal.refined.bar_fit import OWN, SEEN, SHARED, TIMED
from stereocal.refined.distortion import lens_terms
from stereocal.refined.unknowns import ANGLES, RefineSettings, Unknowns, unknowns_of
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.rig.tracks import TimeOffset

GIVEN, ESTIMATED = "given", "estimated from the residuals"
ASSUMED = "assumed, for there are too few points to estimate it"
ASSUMED_PX = 0.5
MINIMUM_PAIRS = 10
"""Pairs needed to estimate the noise: the five angles leave five degrees of freedom."""
MINIMUM_BARS = 5
SCATTER_SIGNIFICANCE = 0.05
"""Significance level of the test whether the bar's length varies."""

DEGREES = np.arange(1, 4)
OUTLIER_PROBABILITY = 1e-5
"""Probability that a good frame exceeds the limit."""
BIWEIGHT_LIMIT = 2.0
"""End of the biweight in units of the limit: a typical frame keeps 0.86 of its weight."""
SMALLEST_SIGMA_PX = 1e-3
"""Lower bound of the estimated noise."""
SMALLEST_SCATTER = 1e-5
"""Lower bound of the estimated scatter, as a fraction of the bar."""
THIRD = 1 / 3
"""Robust scales use this quantile: with 3 of 10 points wrong, half of the frames are bad."""
CHI2_THIRDS = np.append(np.nan, chdtri(DEGREES, 1 - THIRD))
"""That quantile of chi-square with 1, 2 and 3 degrees of freedom; NaN for 0."""
MAXIMUM_ROUNDS = 8
SAME_NOISE = 0.01
"""Relative change of the noise in a round, below which it has converged."""


@dataclass(frozen=True)
class Noise:
    """A standard deviation and its source: `GIVEN`, `ESTIMATED` or `ASSUMED`."""

    value: float
    source: str


class Solve:
    """A solve from one initial pose: the arrays that the compiled code reads and writes."""

    def __init__(
        self,
        dataset: Dataset,
        start: Pose,
        settings: RefineSettings,
        rows: BoolArray | None = None,
    ) -> None:
        self.dataset, self.settings = dataset, settings
        table = dataset.correspondences
        kept = np.ones(len(table), dtype=np.bool_) if rows is None else rows
        bars = kept[table.bars].all(axis=1)
        self.unknowns = unknowns_of(dataset, start, settings, bool(bars.any()))
        self.frames, at = np.unique(table.frame[kept], return_inverse=True)
        n = len(self.frames)
        self.rays = np.full((n, 2, 4), np.nan)
        timed = settings.time_offset or settings.time_drift
        self.pixels = np.full((n, 2, TIMED if timed else SEEN), np.nan)
        target = table.target[kept]
        self.pixels[at, target, :2] = table.primary[kept]
        self.pixels[at, target, 2:SEEN] = table.secondary[kept]
        if timed:
            offset = dataset.time_offset or TimeOffset()
            self.pixels[at, target, SEEN:6] = np.nan_to_num(table.motion[kept, :2])
            self.pixels[at, target, 6] = table.time_frame[kept] - offset.reference
        self.pixel_variance = np.ones((n, 2))
        self.pixel_variance[at, target] = 0.5 + 0.5 * np.nan_to_num(table.motion[kept, 2], nan=1.0)
        self.rays[at, target] = dataset.rays[:, kept].T
        self.distances = np.full(n, np.nan)
        of_bars = np.searchsorted(self.frames, table.frame[table.bars[bars, 0]])
        self.distances[of_bars] = dataset.bar_distances_m[bars]
        bar = np.isfinite(self.distances)
        self.targets = np.isfinite(self.pixels[:, :, 0]).sum(axis=1)
        self.degrees_of_freedom = self.targets + bar
        self.limit = limits_of(self.degrees_of_freedom, len(self.unknowns.names))
        self.lenses = lenses_of(dataset)
        self.p = np.zeros(len(self.unknowns.names))
        self.points = np.full((n, OWN), np.nan)
        self.chi_squares = np.full(n, np.inf)
        self.H = np.zeros((SHARED, SHARED))
        self.smallest_scatter = SMALLEST_SCATTER * dataset.target_distance_m
        self.sigma_px = settings.sigma_px or ASSUMED_PX
        self.scatter = max(settings.scatter_m or 0.0, self.smallest_scatter)
        self.source_px = self.source_scatter = GIVEN
        if settings.sigma_px is None:
            self.source_px = ESTIMATED if len(target) >= MINIMUM_PAIRS else ASSUMED
        if settings.scatter_m is None:
            self.source_scatter = ESTIMATED if bar.sum() >= MINIMUM_BARS else ASSUMED
        self.outlying = np.zeros(n, dtype=np.bool_)
        self.is_near = False
        self.cost, self.steps, self.converged = np.inf, 0, False

    @property
    def q(self) -> FloatArray:
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)

    def start_near(
        self, unknowns: Unknowns, p: FloatArray, sigma_px: float, scatter_m: float
    ) -> bool:
        """Start where another fit ended, with its noise; False if its unknowns are others."""
        if unknowns.names != self.unknowns.names:
            return False
        self.p[len(ANGLES) :] = p[len(ANGLES) :]  # the angles are in the initial pose
        if self.source_px == ESTIMATED:
            self.sigma_px = sigma_px
        if self.source_scatter == ESTIMATED:
            self.scatter = scatter_m
        self._evaluate(self.limit)
        self.outlying = ~(self.chi_squares <= self.limit)
        self.is_near = self.settings.loss == "robust" and not self.outlying.all()
        return self.is_near

    def run(self) -> bool:
        """Solve; return False if there is no solution with a frame that fits."""
        if not self.is_near and not self._approach():
            return False
        for _ in range(MAXIMUM_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            self._solve(np.where(self.outlying, 0.0, np.inf))
            A = self.unknowns.M.T @ self.H @ self.unknowns.M + self.unknowns.precision
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

    def chi_squares_for(
        self, unknowns: Unknowns, p: FloatArray, sigma_px: float, scatter_m: float
    ) -> FloatArray:
        """(f,): the chi-squares of the frames with another fit's parameters and noise."""
        self.unknowns, self.p = unknowns, p
        self.sigma_px, self.scatter = sigma_px, scatter_m
        self._evaluate(self.limit)
        return self.chi_squares

    def equations(
        self, q: FloatArray, groups: Sequence[IntArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Normal equations at q of groups of frames, given by their indices.

        They are 0 for an empty group, and for one with a point behind a camera.

        Returns:
            H (g, 25, 25), J r (g, 25), and the costs (g,).
        """
        n, every = len(groups), np.arange(SHARED)
        H, g, c = np.zeros((n, SHARED, SHARED)), np.zeros((n, SHARED)), np.zeros(n)
        weights = 1 / self.sigma_px, 1 / self.scatter
        for i, own in enumerate(groups):
            seen = self.pixels[own], self.rays[own], self.distances[own]
            points, chi_squares = np.full((len(own), OWN), np.nan), np.empty(len(own))
            plain = np.full(len(own), np.inf)
            c[i] = sum_normal_equations(
                q, every, self.lenses, *seen, *weights, plain, points, chi_squares, H[i], g[i]
            )
        lost = ~np.isfinite(c)
        H[lost], g[lost], c[lost] = 0.0, 0.0, 0.0
        return H, g, c

    def better_than(self, other: Solve) -> bool:
        """Whether the frames fit better here, both measured with the smaller noise."""
        noise = min(self.sigma_px, other.sigma_px)
        own, its = (
            float(np.minimum(a.chi_squares * (a.sigma_px / noise) ** 2, a.limit).sum())
            for a in (self, other)
        )
        return own < its

    def _approach(self) -> bool:
        """From the initial pose to where plain least squares can begin."""
        return self._anneal() if self.settings.loss == "robust" else self._estimate_noise(True)

    def _anneal(self) -> bool:
        """Lower the limit of the biweight in steps; noise from robust scales."""
        for _ in range(MAXIMUM_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            if not self._estimate_noise(robust=True):
                return False
            self._evaluate(self.limit)
            scale = _lower_third(self.chi_squares / CHI2_THIRDS[self.degrees_of_freedom])
            if not np.isfinite(scale):
                return False
            while True:
                scale = max(1.0, scale)
                self._solve(BIWEIGHT_LIMIT * scale * self.limit, ROUGH_TOLERANCE)
                if not np.isfinite(self.cost):
                    return False
                if scale == 1.0:
                    break
                scale *= 0.25
            if self._is_unchanged(before, 0.1):
                break
        self.outlying = ~(self.chi_squares <= self.limit)
        return bool((~self.outlying).any())

    def _is_unchanged(self, before: tuple[float, float, BoolArray], same: float) -> bool:
        sigma, scatter, outlying = before
        return (
            abs(self.sigma_px - sigma) <= same * sigma
            and abs(self.scatter - scatter) <= max(same * scatter, 0.1 * self.smallest_scatter)
            and bool((outlying == self.outlying).all())
        )

    def _solve(self, limits: FloatArray, tolerance: float = TOLERANCE) -> None:
        self.cost, steps, self.converged = adjust(
            self.unknowns.origin,
            self.unknowns.M,
            self.unknowns.free,
            self.unknowns.precision,
            self.p,
            self.lenses,
            self.pixels,
            self.rays,
            self.distances,
            1 / self.sigma_px,
            1 / self.scatter,
            limits,
            self.points,
            self.chi_squares,
            self.H,
            tolerance,
            self.settings.maximum_steps,
        )
        self.steps += steps

    def _evaluate(self, limits: FloatArray) -> None:
        self._sum(1 / self.scatter, limits, self.points, self.chi_squares, self.H)

    def _sum(
        self,
        length_weight: float,
        limits: FloatArray,
        points: FloatArray,
        chi_squares: FloatArray,
        H: FloatArray,
    ) -> None:
        sum_normal_equations(
            self.q,
            self.unknowns.free,
            self.lenses,
            self.pixels,
            self.rays,
            self.distances,
            1 / self.sigma_px,
            length_weight,
            limits,
            points,
            chi_squares,
            H,
            np.empty(SHARED),
        )

    def _estimate_noise(self, robust: bool = False) -> bool:
        """Estimate sigma_px from the pixel residuals alone, and then the scatter of the lengths.

        Returns False if no frame can be fitted.
        """
        if ESTIMATED not in (self.source_px, self.source_scatter):
            return True
        points, chi_squares = self.points.copy(), np.empty(len(self.frames))
        H = np.empty((SHARED, SHARED))
        self._sum(0.0, np.where(self.outlying, 0.0, np.inf), points, chi_squares, H)
        spent_px, spent_m = (0.0, 0.0) if robust else self._spent(H)
        if self.source_px == ESTIMATED:
            if robust:
                ratio = _lower_third(chi_squares / CHI2_THIRDS[self.targets])
            else:
                good = ~self.outlying & np.isfinite(chi_squares)
                left = float(self.targets[good].sum()) - spent_px
                left *= float(self.pixel_variance[good].mean()) if good.any() else 1.0
                ratio = float(chi_squares[good].sum()) / max(left, 1.0)
            if not np.isfinite(ratio):
                return False
            self.sigma_px = max(self.sigma_px * float(np.sqrt(ratio)), SMALLEST_SIGMA_PX)
        if self.source_scatter == ESTIMATED:
            found = np.empty((len(self.frames), 2))
            length_innovations(
                self.q, self.lenses, self.pixels, self.distances, 1 / self.sigma_px, points, found
            )
            good = np.isfinite(found[:, 0]) & ~self.outlying
            self.scatter = max(
                scatter_of(found[good, 0], found[good, 1], spent_m, robust), self.smallest_scatter
            )
        return True

    def _spent(self, of_pixels: FloatArray) -> tuple[float, float]:
        """Degrees of freedom used by the unknowns, of the pixels and of the lengths.

        They are the traces of the two parts of the hat matrix.
        """
        M = self.unknowns.M
        pixels, everything = M.T @ of_pixels @ M, M.T @ self.H @ M
        A = everything + self.unknowns.precision
        scale = 1.0 / np.sqrt(np.maximum(np.diag(A), 1e-300))
        A = A * np.outer(scale, scale)
        C = np.linalg.pinv(A, hermitian=True) * np.outer(scale, scale)
        return float(np.sum(C * pixels)), max(float(np.sum(C * (everything - pixels))), 0.0)


def limits_of(degrees_of_freedom: IntArray, unknowns: int) -> FloatArray:
    """(n,): the chi-square above which a frame is an outlier.

    The noise is estimated from the same frames. Chi-square over degrees of freedom therefore
    follows the F distribution: with 25 bars the limit is 26 instead of 21.

    Args:
        degrees_of_freedom: (n,), of each frame.
        unknowns: number of unknowns.
    """
    left = max(int(degrees_of_freedom.sum()) - unknowns, 1)
    by_freedom = np.append(np.nan, DEGREES * fdtri(DEGREES, left, 1.0 - OUTLIER_PROBABILITY))
    return np.asarray(by_freedom[degrees_of_freedom])


def lenses_of(dataset: Dataset) -> FloatArray:
    """(2, 23): skew and `lens_terms` of both cameras, as stated."""
    return lenses_of_cameras(dataset.primary, dataset.secondary)


def lenses_of_cameras(primary: Camera, secondary: Camera) -> FloatArray:
    """(2, 23): skew and `lens_terms` of both cameras."""
    return np.array([np.append(c.K[0, 1], lens_terms(c)) for c in (primary, secondary)])


def scatter_of(
    innovations: FloatArray, variances: FloatArray, spent: float = 0.0, robust: bool = False
) -> float:
    """The scatter of the bar's length beyond the noise of the pixels, in metres.

    Solves sum(e^2 / (scatter^2 + v)) = n - spent (Mandel and Paule), or, if `robust`, the same for
    the lower third. Returns 0 unless the sum without scatter is significant at the level
    `SCATTER_SIGNIFICANCE`. Otherwise half of all rigid bars would get a scatter, and the standard
    error of the scale would be too large (measured with 25 frames: errors of the baseline are 0.93
    of the stated ones, and 0.97 with the test).

    Args:
        innovations: (n,): e, reconstructed minus stated lengths, in metres.
        variances: (n,): v, the variances of e from the pixels, in square metres.
        spent: degrees of freedom of the lengths used by the unknowns.
    """
    squares = np.square(innovations)
    left = max(len(squares) - spent, 1.0)
    if len(squares) < 2 or not float(np.sum(squares / variances)) > chdtri(
        left, SCATTER_SIGNIFICANCE
    ):
        return 0.0
    third = CHI2_THIRDS[1] if robust else 0.0
    return float(np.sqrt(excess_variance(squares, variances, left, third)))


def _lower_third(values: FloatArray, axis: int | None = None) -> Any:
    """The lower third quantile; values may be infinite."""
    return np.quantile(values, THIRD, axis=axis, method="lower")
