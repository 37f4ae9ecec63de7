"""The solve of the refined method: from a start to the least squares, with noise and gross errors.

A frame's loss is Tukey's biweight of its misfit s, a sum of squares that follows chi-squared for a
good frame, with a limit that comes down to its place in steps (graduated non-convexity; Yang et
al., IEEE RA-L 2020). Frames beyond the limit at the end are left out, and the rest are adjusted by
plain least squares. Noise that is not given is estimated between the rounds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtri, fdtri

from stereocal.refined.adjustment import CONVERGED, ROUGHLY, adjust, length_innovations, sums
from stereocal.refined.bar_fit import OWN, SHARED
from stereocal.refined.distortion import lens_terms
from stereocal.refined.unknowns import RefineSettings, Unknowns, unknowns_of
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose

GIVEN, ESTIMATED = "given", "estimated from the residuals"
ASSUMED = "assumed, for there are too few points to estimate it"
ASSUMED_PX = 0.5
FEWEST_PAIRS = 10
"""Five angles leave five residuals of ten pairs to tell the noise by."""
FEWEST_BARS = 5
CHANCE = 0.05
"""A bar counts as rigid unless its lengths scatter more than so few rigid ones would."""

FREEDOMS = np.arange(1, 4)
RARE = 1e-5
"""A frame stands out when a good one would have such a misfit so seldom."""
SOFT = 2.0
"""The biweight ends at so many times the limit: a usual frame keeps 0.86 of its weight."""
SMALLEST_SIGMA_PX = 1e-3
"""No image point is known better."""
SMALLEST_SCATTER = 1e-5
"""As a fraction of the bar."""
THIRD = 1 / 3
"""Robust scales look at the best third: with 3 of 10 points wrong, half of the frames are bad."""
THIRDS = np.append(np.nan, chdtri(FREEDOMS, 1 - THIRD))
"""That quantile of chi-squared with 1, 2 and 3 degrees of freedom; NaN for 0."""
MOST_ROUNDS = 8
SAME_NOISE = 0.01
"""The noise is found when a round changes it by a smaller part."""


@dataclass(frozen=True)
class Noise:
    """A standard deviation and where it comes from: `GIVEN`, `ESTIMATED` or `ASSUMED`."""

    value: float
    source: str


class Solve:
    """The state of a solve: arrays that the compiled code reads and writes. `run` does it."""

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
        self.pixels, self.rays = np.full((n, 2, 4), np.nan), np.full((n, 2, 4), np.nan)
        target = table.target[kept]
        self.pixels[at, target, :2] = table.primary[kept]
        self.pixels[at, target, 2:] = table.secondary[kept]
        self.rays[at, target] = dataset.rays[:, kept].T
        self.distances = np.full(n, np.nan)
        of_bars = np.searchsorted(self.frames, table.frame[table.bars[bars, 0]])
        self.distances[of_bars] = dataset.bar_distances_m[bars]
        bar = np.isfinite(self.distances)
        self.targets = np.isfinite(self.pixels[:, :, 0]).sum(axis=1)
        self.freedom = self.targets + bar
        self.limit = limits_of(self.freedom, len(self.unknowns.names))
        self.lenses = lenses_of(dataset)
        self.p = np.zeros(len(self.unknowns.names))
        self.places = np.full((n, OWN), np.nan)
        self.misfits = np.full(n, np.inf)
        self.H = np.zeros((SHARED, SHARED))
        self.smallest_scatter = SMALLEST_SCATTER * dataset.target_distance_m
        self.sigma_px = settings.sigma_px or ASSUMED_PX
        self.scatter = max(settings.scatter_m or 0.0, self.smallest_scatter)
        self.source_px = self.source_scatter = GIVEN
        if settings.sigma_px is None:
            self.source_px = ESTIMATED if len(target) >= FEWEST_PAIRS else ASSUMED
        if settings.scatter_m is None:
            self.source_scatter = ESTIMATED if bar.sum() >= FEWEST_BARS else ASSUMED
        self.outlying = np.zeros(n, dtype=np.bool_)
        self.cost, self.steps, self.converged = np.inf, 0, False

    @property
    def q(self) -> FloatArray:
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)

    def run(self) -> bool:
        """From the start to the end; false if no frame fits anywhere."""
        if not (self._come_down() if self.settings.loss == "robust" else self._begin()):
            return False
        for _ in range(MOST_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            self._solve(np.where(self.outlying, 0.0, np.inf))
            if not np.isfinite(self.cost) or not self._estimate_noise():
                return False
            if self.settings.loss == "robust":
                now = self.misfits * (before[0] / self.sigma_px) ** 2
                self.outlying = ~(now <= self.limit)
            if self._settled(before, SAME_NOISE):
                break
        self._solve(np.where(self.outlying, 0.0, np.inf))
        return bool(np.isfinite(self.cost)) and not self.outlying.all()

    def judged(
        self, unknowns: Unknowns, p: FloatArray, sigma_px: float, scatter_m: float
    ) -> FloatArray:
        """(f,): the misfits that the frames have with a fit to other frames."""
        self.unknowns, self.p = unknowns, p
        self.sigma_px, self.scatter = sigma_px, scatter_m
        self._evaluate(self.limit)
        return self.misfits

    def better_than(self, other: Solve) -> bool:
        """Whether frames fit better here, all measured by the smaller noise of the two."""
        noise = min(self.sigma_px, other.sigma_px)
        own, its = (
            float(np.minimum(a.misfits * (a.sigma_px / noise) ** 2, a.limit).sum())
            for a in (self, other)
        )
        return own < its

    def _begin(self) -> bool:
        """Plain least squares with the noise that the start leaves."""
        return self._estimate_noise(robust=True)

    def _come_down(self) -> bool:
        """The biweight with a limit that comes down to its place, noise by medians."""
        for _ in range(MOST_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            if not self._estimate_noise(robust=True):
                return False
            self._evaluate(self.limit)
            scale = _third(self.misfits / THIRDS[self.freedom])
            if not np.isfinite(scale):
                return False
            while True:
                scale = max(1.0, scale)
                self._solve(SOFT * scale * self.limit, ROUGHLY)
                if not np.isfinite(self.cost):
                    return False
                if scale == 1.0:
                    break
                scale *= 0.25
            if self._settled(before, 0.1):
                break
        self.outlying = ~(self.misfits <= self.limit)
        return bool((~self.outlying).any())

    def _settled(self, before: tuple[float, float, BoolArray], same: float) -> bool:
        sigma, scatter, outlying = before
        return (
            abs(self.sigma_px - sigma) <= same * sigma
            and abs(self.scatter - scatter) <= max(same * scatter, 0.1 * self.smallest_scatter)
            and bool((outlying == self.outlying).all())
        )

    def _solve(self, limits: FloatArray, tolerance: float = CONVERGED) -> None:
        self.cost, steps, self.converged = adjust(
            self.unknowns.origin, self.unknowns.M, self.unknowns.precision, self.p, self.lenses,
            self.pixels, self.rays, self.distances, 1 / self.sigma_px, 1 / self.scatter, limits,
            self.places, self.misfits, self.H, tolerance, self.settings.maximum_steps,
        )  # fmt: skip
        self.steps += steps

    def _evaluate(self, limits: FloatArray) -> None:
        sums(
            self.q, self.lenses, self.pixels, self.rays, self.distances, 1 / self.sigma_px,
            1 / self.scatter, limits, self.places, self.misfits, self.H, np.empty(SHARED),
        )  # fmt: skip

    def _estimate_noise(self, robust: bool = False) -> bool:
        """sigma_px from the misfit of the pixels alone, the scatter from what the lengths add."""
        places, misfits = self.places.copy(), np.empty(len(self.frames))
        H = np.empty((SHARED, SHARED))
        used = np.where(self.outlying, 0.0, np.inf)
        sums(
            self.q, self.lenses, self.pixels, self.rays, self.distances, 1 / self.sigma_px, 0.0,
            used, places, misfits, H, np.empty(SHARED),
        )  # fmt: skip
        spent_px, spent_m = (0.0, 0.0) if robust else self._spent(H)
        if self.source_px == ESTIMATED:
            if robust:
                ratio = _third(misfits / THIRDS[self.targets])
            else:
                good = ~self.outlying & np.isfinite(misfits)
                left = float(self.targets[good].sum()) - spent_px
                ratio = float(misfits[good].sum()) / max(left, 1.0)
            if not np.isfinite(ratio):
                return False
            self.sigma_px = max(self.sigma_px * float(np.sqrt(ratio)), SMALLEST_SIGMA_PX)
        if self.source_scatter == ESTIMATED:
            found = np.empty((len(self.frames), 2))
            length_innovations(
                self.q, self.lenses, self.pixels, self.distances, 1 / self.sigma_px, places, found
            )
            good = np.isfinite(found[:, 0]) & ~self.outlying
            self.scatter = max(
                scatter_of(found[good, 0], found[good, 1], spent_m, robust), self.smallest_scatter
            )
        return True

    def _spent(self, of_pixels: FloatArray) -> tuple[float, float]:
        """How many pixel residuals and lengths went into the unknowns (traces of the hat)."""
        M = self.unknowns.M
        pixels, everything = M.T @ of_pixels @ M, M.T @ self.H @ M
        scale = 1.0 / np.sqrt(np.maximum(np.diag(everything) + self.unknowns.precision, 1e-300))
        A = (everything + np.diag(self.unknowns.precision)) * np.outer(scale, scale)
        C = np.linalg.pinv(A, hermitian=True) * np.outer(scale, scale)
        return float(np.sum(C * pixels)), max(float(np.sum(C * (everything - pixels))), 0.0)


def limits_of(freedom: IntArray, unknowns: int) -> FloatArray:
    """(n,): the misfit beyond which a frame of so many degrees of freedom stands out.

    The noise is estimated from the same frames, so a good frame's misfit over its degrees of
    freedom follows F rather than chi-squared: with 25 bars the limit is 26 instead of 21.
    """
    left = max(int(freedom.sum()) - unknowns, 1)
    by_freedom = np.append(np.nan, FREEDOMS * fdtri(FREEDOMS, left, 1.0 - RARE))
    return np.asarray(by_freedom[freedom])


def lenses_of(dataset: Dataset) -> FloatArray:
    """(2, 23): what of the two lenses stays: skew and distortion."""
    return np.array(
        [np.append(c.K[0, 1], lens_terms(c)) for c in (dataset.primary, dataset.secondary)]
    )


def scatter_of(
    innovations: FloatArray, variances: FloatArray, spent: float = 0.0, robust: bool = False
) -> float:
    """The scatter that explains the lengths beyond the noise of the pixels, in metres.

    Solves sum(e^2 / (scatter^2 + v)) = n - spent (Mandel and Paule), or, `robust`, the same for the
    best third of squared normal numbers. 0 where the pixels explain all, which is believed unless
    the sum without scatter is rarer than `CHANCE`: half of all rigid bars would have a scatter
    otherwise, and the scale would seem less sure than it is (measured on 25 frames: errors of the
    baseline are 0.93 of the stated ones, 0.97 with this).

    Args:
        innovations: (n,), e, reconstructed less stated lengths, in metres.
        variances: (n,), v, from the pixels, in square metres.
        spent: how many lengths went into the unknowns.
    """
    squares = np.square(innovations)
    left = max(len(squares) - spent, 1.0)
    if len(squares) < 2 or not float(np.sum(squares / variances)) > chdtri(left, CHANCE):
        return 0.0
    high = float(squares.max()) * len(squares) * 10
    candidates = np.geomspace(1e-9 * high, high, 64)
    for _ in range(3):  # ends within 1e-4 of the root; 64 at once take as long as one
        terms = squares / (candidates[:, None] + variances)
        if robust:
            excess = _third(terms, axis=1) / THIRDS[1] - 1.0
        else:
            excess = terms.sum(axis=1) / left - 1.0
        above = int(np.count_nonzero(excess > 0))  # it falls with the scatter
        if above == 0:
            return float(np.sqrt(candidates[0]))
        last = min(above, len(candidates) - 1)
        candidates = np.geomspace(candidates[above - 1], candidates[last], 64)
    return float(np.sqrt(candidates[32]))


def _third(values: FloatArray, axis: int | None = None) -> Any:
    """The value that a third stays below, infinite ones included."""
    return np.quantile(values, THIRD, axis=axis, method="lower")
