"""The robust fit of the refined method: outlying frames, noise, final least squares.

The loss of a frame is Tukey's biweight of its chi-square, with a limit that is lowered in steps
(graduated non-convexity; Yang et al., IEEE RA-L 2020). Frames beyond the final limit are left out,
and the others are adjusted by plain least squares. Noise that is not given is estimated between
the rounds.
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import chdtri, fdtri

from stereocal.refined.adjustment import (
    ROUGH_TOLERANCE,
    TOLERANCE,
    Parameters,
    State,
    adjust,
    equations_for,
    excess_variance,
    length_innovations,
    sum_normal_equations,
)
from stereocal.refined.unknowns import RefineSettings, Unknowns
from stereocal.refined.views import OWN, Cameras, Units
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray

GIVEN, ESTIMATED = "given", "estimated from the residuals"
ASSUMED = "assumed, for there are too few points to estimate it"
ASSUMED_PX = 0.5
MINIMUM_PAIRS = 10
"""Pairs needed to estimate the noise: the five angles leave five degrees of freedom."""
MINIMUM_BARS = 5
SCATTER_SIGNIFICANCE = 0.05
"""Significance level of the test whether the bar's length varies."""

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
MAXIMUM_ROUNDS = 8
SAME_NOISE = 0.01
"""Relative change of the noise in a round, below which it has converged."""


@dataclass(frozen=True)
class Noise:
    """A standard deviation and its source: `GIVEN`, `ESTIMATED` or `ASSUMED`."""

    value: float
    source: str


class RobustFit(ABC):
    """A robust fit of frames that N cameras see; a pair is the case of two.

    A subclass sets the attributes: the arrays that the compiled code reads and writes. Those have a
    row for each unit of points (`views`): a bar is one, the placing of an object several.
    """

    settings: RefineSettings
    unknowns: Unknowns
    """Of free parameters p, and the shared unknowns q (Q,)."""
    frames: IntArray
    """(f,): the frame numbers."""
    frame_of: IntArray
    """(n,): index of the frame of each unit."""
    pixel_variance: FloatArray
    """(f, ...): variances of its pixels over those of recorded ones."""
    lenses: FloatArray
    """(c, 23), and the next ones (n, ...), as in `views.Units`."""
    pixels: FloatArray
    rays: FloatArray
    motion: FloatArray
    distances: FloatArray
    R: FloatArray
    """(c, 3, 3): of the last step."""
    baselines: FloatArray
    """(m, 4): as in `adjustment.add_baselines`."""

    def _begin(self, unknowns: Unknowns, length_m: float) -> None:
        """Set what every fit begins with, after the other attributes.

        Args:
            length_m: of the bar, or the longest of the object.
        """
        known, of_pixels = np.isfinite(self.distances), unit_freedom(self.pixels)
        self.unit_freedom = of_pixels + known
        self.pixel_freedom = self.by_frame(of_pixels).astype(np.int64)
        self.degrees_of_freedom = self.by_frame(self.unit_freedom).astype(np.int64)
        self.set_limits(len(unknowns.names))
        images = np.isfinite(self.pixels[..., 0]).sum()
        enough = images // 2 >= MINIMUM_PAIRS, known.sum() >= MINIMUM_BARS
        given = self.settings
        self.smallest_scatter = SMALLEST_SCATTER * length_m
        self.sigma_px = given.sigma_px or ASSUMED_PX
        self.scatter = max(given.scatter_m or 0.0, self.smallest_scatter)
        self.source_px, self.source_scatter = (
            GIVEN if value is not None else ESTIMATED if known else ASSUMED
            for value, known in zip((given.sigma_px, given.scatter_m), enough, strict=True)
        )
        self.start_with(unknowns, np.zeros(len(unknowns.names)))
        # Points and chi-squares (n,) of the units, chi-squares (f,) of the frames, and the normal
        # equations (Q, Q) of q without priors.
        self.points = np.full((len(self.pixels), OWN), np.nan)
        self.of_units = np.full(len(self.pixels), np.inf)
        self.chi_squares = np.full(len(self.frames), np.inf)
        self.H = np.zeros((len(unknowns.origin),) * 2)
        self.outlying = np.zeros(len(self.frames), dtype=np.bool_)
        self.is_near = False
        self.cost, self.steps, self.converged = np.inf, 0, False

    def set_limits(self, unknowns: int) -> None:
        """Set the chi-squares above which frames (f,) are outliers, for a number of unknowns, and
        the shares (n,) of their units in them."""
        self.limit = frame_limits(self.unit_freedom, self.frame_of, unknowns)
        of_units = limits_of(self.unit_freedom, unknowns)
        self.share_of_limit = of_units / self.limit[self.frame_of]

    def start_with(self, unknowns: Unknowns, p: FloatArray) -> None:
        """Set the unknowns, and where their free parameters (k,) begin."""
        self.unknowns, self.p = unknowns, p
        self.turns = np.zeros(len(p), dtype=np.bool_)
        B = self.views(unknowns.origin)[2]
        M = np.abs(unknowns.M.T)
        self.free: BoolArray = np.asarray((M if B is None else M @ np.abs(B)).any(axis=0))

    @property
    def q(self) -> FloatArray:
        """(Q,): the shared unknowns."""
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)

    @property
    def has_parts(self) -> bool:
        """Whether frames have several units, whose errors may be alike."""
        return len(self.frame_of) > len(self.frames)

    @abstractmethod
    def views(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray | None]:
        """The unknowns (V,) of `views`, R (c, 3, 3), and the derivatives (Q, V) of the unknowns by
        q; None if they are q."""

    def by_frame(self, of_units: npt.ArrayLike) -> FloatArray:
        """(f,): sums over the units of each frame."""
        return np.bincount(self.frame_of, of_units, len(self.frames)).astype(np.float64)

    def _units(self, length_weight: float, own: IntArray | slice = slice(None)) -> Units:
        """What was measured of some units."""
        motion = self.motion[own] if len(self.motion) else self.motion
        pixels, rays, distances = self.pixels[own], self.rays[own], self.distances[own]
        return Units(pixels, rays, motion, distances, 1 / self.sigma_px, length_weight)

    def _solve(self, limits: FloatArray, tolerance: float = TOLERANCE) -> None:
        """Minimise the cost with these limits (f,) of the loss; updates all results."""
        own, found = self.unknowns, equations_for(self.free)
        self.cost, steps, self.converged = adjust(
            Parameters(own.origin, np.ascontiguousarray(own.M.T), own.precision, self.turns),
            State(self.p, self.R, self.points, self.of_units),
            self.lenses,
            self._units(1 / self.scatter),
            self.baselines,
            limits[self.frame_of] * self.share_of_limit,
            found,
            tolerance,
            self.settings.maximum_steps,
        )
        B = self.views(self.q)[2]
        self.H[:] = found.H if B is None else B @ found.H @ B.T
        self.chi_squares[:] = self.by_frame(self.of_units)
        self.steps += steps

    def sum_at(
        self,
        q: FloatArray,
        length_weight: float,
        limits: FloatArray,
        points: FloatArray,
        chi_squares: FloatArray,
        units: IntArray | slice = slice(None),
        free: BoolArray | None = None,
    ) -> tuple[float, FloatArray, FloatArray]:
        """Cost, H (Q, Q) and g (Q,) at q, as of `adjustment.sum_normal_equations`.

        Args:
            limits, points, chi_squares: of the units.
            free: (V,): None for those that are not held fixed.
        """
        v, R, B = self.views(q)
        measured = self._units(length_weight, units)
        into = equations_for(self.free if free is None else free)
        cameras = Cameras(v, R, self.lenses)
        cost = sum_normal_equations(cameras, measured, limits, points, chi_squares, into)
        return (cost, into.H, into.g) if B is None else (cost, B @ into.H @ B.T, B @ into.g)

    def innovations(self, q: FloatArray, points: FloatArray) -> FloatArray:
        """(n, 2): as of `adjustment.length_innovations`."""
        (v, R, _), found = self.views(q), np.empty((len(points), 2))
        length_innovations(Cameras(v, R, self.lenses), self._units(1.0), points, found)
        return found

    def equations(
        self, q: FloatArray, groups: Sequence[IntArray]
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Normal equations at q of groups of frames, given by their indices.

        They are 0 for an empty group, and for one with a point behind a camera.

        Returns:
            H (g, Q, Q), J r (g, Q), and the costs (g,).
        """
        n, count, every = len(groups), len(q), np.ones(len(self.free), dtype=np.bool_)
        H, g, c = np.zeros((n, count, count)), np.zeros((n, count)), np.zeros(n)
        for i, group in enumerate(groups):
            own = np.flatnonzero(np.isin(self.frame_of, group)) if self.has_parts else group
            points, size = np.full((len(own), OWN), np.nan), len(own)
            c[i], H[i], g[i] = self.sum_at(
                q, 1 / self.scatter, np.full(size, np.inf), points, np.empty(size), own, every
            )
        lost = ~np.isfinite(c)
        H[lost], g[lost], c[lost] = 0.0, 0.0, 0.0
        return H, g, c

    def _evaluate(self, limits: FloatArray) -> None:
        """Points, chi-squares and H at the present parameters."""
        own = limits[self.frame_of] * self.share_of_limit
        _, self.H[:], _ = self.sum_at(self.q, 1 / self.scatter, own, self.points, self.of_units)
        self.chi_squares[:] = self.by_frame(self.of_units)

    def run(self) -> bool:
        """Solve; return False if there is no solution with a frame that fits."""
        if not self.is_near and not (
            self._anneal() if self.settings.loss == "robust" else self._estimate_noise(True)
        ):
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

    def _anneal(self) -> bool:
        """Lower the limit of the biweight in steps; noise from robust scales."""
        for _ in range(MAXIMUM_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            if not self._estimate_noise(robust=True):
                return False
            self._evaluate(self.limit)
            scale = _lower_third(self.chi_squares / thirds_of(self.degrees_of_freedom))
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

    def _estimate_noise(self, robust: bool = False) -> bool:
        """Estimate sigma_px from the pixel residuals alone, and then the scatter of the lengths.

        Returns False if no frame can be fitted.
        """
        if ESTIMATED not in (self.source_px, self.source_scatter):
            return True
        points, of_units = self.points.copy(), np.empty(len(self.points))
        limits = np.where(self.outlying, 0.0, np.inf)[self.frame_of]
        _, H, _ = self.sum_at(self.q, 0.0, limits, points, of_units)
        chi_squares = self.by_frame(of_units)
        spent_px, spent_m = (0.0, 0.0) if robust else self._spent(H)
        if self.source_px == ESTIMATED:
            if robust:
                ratio = _lower_third(chi_squares / thirds_of(self.pixel_freedom))
            else:
                good = ~self.outlying & np.isfinite(chi_squares)
                left = float(self.pixel_freedom[good].sum()) - spent_px
                left *= float(self.pixel_variance[good].mean()) if good.any() else 1.0
                ratio = float(chi_squares[good].sum()) / max(left, 1.0)
            if not np.isfinite(ratio):
                return False
            self.sigma_px = max(self.sigma_px * float(np.sqrt(ratio)), SMALLEST_SIGMA_PX)
        if self.source_scatter == ESTIMATED:
            found = self.innovations(self.q, points)
            found = found[np.isfinite(found[:, 0]) & ~self.outlying[self.frame_of]]
            self.scatter = max(
                scatter_of(found[:, 0], found[:, 1], spent_m, robust), self.smallest_scatter
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


def unit_freedom(pixels: FloatArray) -> IntArray:
    """(n,): degrees of freedom of the pixels (n, 2, c, 2) of units: two for each image of a point,
    less three for the point."""
    views = np.isfinite(pixels[..., 0]).sum(axis=2)
    return np.asarray(np.where(views > 0, 2 * views - 3, 0).sum(axis=1))


def frame_limits(freedom: IntArray, frame_of: IntArray, unknowns: int) -> FloatArray:
    """(f,): the chi-square above which a frame is an outlier, by `limits_of`.

    The points of one placing have errors that are alike: it is judged by their mean, as one unit.

    Args:
        freedom: (n,), of each unit; frame_of: (n,), the index of its frame.
    """
    of_frame = np.bincount(frame_of, freedom)
    largest = np.zeros(len(of_frame), np.int64)
    np.maximum.at(largest, frame_of, freedom)
    with np.errstate(invalid="ignore"):
        return limits_of(largest, unknowns) * (of_frame / largest)


def limits_of(degrees_of_freedom: IntArray, unknowns: int) -> FloatArray:
    """(n,): the chi-square above which a frame is an outlier.

    The noise is estimated from the same frames. Chi-square over degrees of freedom therefore
    follows the F distribution: with 25 bars the limit is 26 instead of 21.

    Args:
        degrees_of_freedom: (n,), of each frame.
        unknowns: number of unknowns.
    """
    left = max(int(degrees_of_freedom.sum()) - unknowns, 1)
    degrees = np.where(degrees_of_freedom > 0, degrees_of_freedom, np.nan)
    return np.asarray(degrees * fdtri(degrees, left, 1.0 - OUTLIER_PROBABILITY))


def thirds_of(degrees_of_freedom: IntArray) -> FloatArray:
    """(n,): the quantile `THIRD` of chi-square; NaN for 0 degrees of freedom."""
    degrees = np.where(degrees_of_freedom > 0, degrees_of_freedom, np.nan)
    return np.asarray(chdtri(degrees, 1 - THIRD))


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
    third = float(chdtri(1.0, 1 - THIRD)) if robust else 0.0
    return float(np.sqrt(excess_variance(squares, variances, left, third)))


def _lower_third(values: FloatArray) -> Any:
    """The lower third quantile; values may be infinite."""
    return np.quantile(values, THIRD, method="lower")
