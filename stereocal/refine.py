"""Method 4, refined: one set that matches and measures, by one weighted least squares.

Pixel residuals over their noise, lengths of the bar over their scatter, and priors on the measured
baseline, the measured bar and both lenses are adjusted together (`adjustment`). The places of the
targets are eliminated, so a bar far away or along the line of sight weighs as little as the images
say of its length.

Gross errors: a frame's loss is Tukey's biweight of its misfit s, a sum of squares that follows
chi-squared for a good frame, with a limit that comes down to its place in steps (graduated
non-convexity; Yang et al., IEEE RA-L 2020). Frames beyond the limit at the end are named and left
out, and the rest are adjusted by plain least squares, whose covariance is that of the result.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from scipy.stats import chi2

from stereocal.adjustment import CONVERGED, ROUGHLY, adjust, length_innovations, sums
from stereocal.bar_fit import BAR, BASELINE, EPSILON, OWN, PRIMARY, SECONDARY, SHARED
from stereocal.camera import Camera
from stereocal.compiled import FloatArray, IntArray
from stereocal.dataset import Dataset
from stereocal.distortion import lens_terms
from stereocal.errors import StereocalError
from stereocal.essential import calibrate_essential, choose_pose
from stereocal.geometry import Angles, Pose, residuals
from stereocal.unknowns import RefineSettings, Unknowns, camera_of, unknowns_of

GIVEN, ESTIMATED = "given", "estimated from the residuals"

RARE = 1e-4
"""A frame stands out when a good one would have such a misfit so seldom."""
SOFT = 2.0
"""The biweight ends at so many times the limit: a usual frame keeps 0.86 of its weight."""
SMALLEST_SIGMA_PX = 1e-3
"""No image point is known better."""
SMALLEST_SCATTER = 1e-5
"""As a fraction of the bar."""
MEDIANS = np.array([np.nan, *chi2.median([1, 2, 3])])
"""Of chi-squared with 1, 2 and 3 degrees of freedom; SciPy takes longer than a solve for one."""
MOST_ROUNDS = 8
SAME_NOISE = 0.01
"""The noise is found when a round changes it by a smaller part."""


@dataclass(frozen=True)
class Noise:
    """A standard deviation and where it comes from: `GIVEN` or `ESTIMATED`."""

    value: float
    source: str


@dataclass(frozen=True, eq=False)
class RefinedResult:
    """The one set: pose and lenses with their covariance, and how each frame fits."""

    dataset: Dataset
    settings: RefineSettings
    pose: Pose
    primary: Camera
    secondary: Camera
    unknowns: Unknowns
    p: FloatArray
    """(k,), what was estimated, as departures from `unknowns.origin`."""
    information: FloatArray
    """(15, 15), of the images and lengths on the shared unknowns, without the priors."""
    sigma_px: Noise
    scatter_m: Noise
    """Error of the bar's length that differs from frame to frame."""
    frames: IntArray
    """(f,), the frame numbers."""
    misfits: FloatArray
    """(f,): sum of squares of each frame in standard deviations; infinite behind a camera."""
    freedom: IntArray
    """(f,): what a good frame's misfit is on average: 3 for a bar, 1 for a single target."""
    outlying: npt.NDArray[np.bool_]
    """(f,): the frames that were left out."""
    places_m: FloatArray
    """(f, 2, 3): A and B in the primary's frame, with the lengths taken in; NaN if not seen."""
    cost: float
    """Sum of the misfits of the frames used and of the priors."""
    steps: int
    stop_reason: str
    seconds: float

    @cached_property
    def q(self) -> FloatArray:
        """(15,): the shared unknowns, as in `bar_fit`."""
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)

    @cached_property
    def lenses(self) -> FloatArray:
        """(2, 23): skew and distortion of both lenses, for the compiled functions."""
        return lenses_of(self.dataset)

    @cached_property
    def p_covariance(self) -> FloatArray:
        """(k, k): covariance of the free numbers, priors included."""
        M = self.unknowns.M
        A = M.T @ self.information @ M + np.diag(self.unknowns.precision)
        scale = 1.0 / np.sqrt(np.diag(A))
        return np.asarray(np.linalg.inv(A * np.outer(scale, scale)) * np.outer(scale, scale))

    @cached_property
    def covariance(self) -> FloatArray:
        """(15, 15): covariance of the shared unknowns; 0 for those held fixed."""
        M = self.unknowns.M
        return np.asarray(M @ self.p_covariance @ M.T)

    @property
    def outlying_frames(self) -> dict[int, float]:
        """The frames left out with their share of the misfit of all frames, largest first."""
        finite = np.where(np.isfinite(self.misfits), self.misfits, np.nanmax(self._known) * 10)
        share = finite / max(float(finite.sum()), 1e-300)
        order = np.argsort(-finite, kind="stable")
        return {int(self.frames[i]): float(share[i]) for i in order if self.outlying[i]}

    @property
    def _known(self) -> FloatArray:
        return np.append(self.misfits[np.isfinite(self.misfits)], 1.0)

    @property
    def bar_factor(self) -> float:
        """True over stated length of the bar, as estimated."""
        return float(self.q[BAR])

    def apply(self, dataset: Dataset) -> Dataset:
        """Another data set of the same rig, seen through the refined lenses."""
        return replace(dataset, primary=self.primary, secondary=self.secondary)


def refine(
    dataset: Dataset, settings: RefineSettings | None = None, start: Pose | None = None
) -> RefinedResult:
    """The refined set of a data set.

    Args:
        start: where to begin, such as the essential method's pose; found here when not given.
            Where frames stand out, a start that ignores gross errors is tried too.

    Raises:
        StereocalError: too few points, no scale, or nothing that fits.
    """
    settings = settings or RefineSettings()
    began = time.perf_counter()
    found: _Adjustment | None = None
    for pose in _starts(dataset, start, settings):
        if found is not None and not found.outlying.any():
            break
        other = _solved(dataset, pose, settings)
        if found is None or (other is not None and other.better_than(found)):
            found = other
    if found is None:
        raise StereocalError(
            "The refined method found no position of the cameras that fits: check that points, "
            "targets and camera files are not exchanged."
        )
    return found.result(time.perf_counter() - began)


def _starts(dataset: Dataset, start: Pose | None, settings: RefineSettings) -> list[Pose]:
    """Where to begin: the given or the essential pose and one that ignores gross errors.

    The better one, by the median of the residuals, comes first.
    """
    if start is None:
        try:
            start = calibrate_essential(dataset.rays, dataset.baseline_m).pose
        except StereocalError:
            start = None
    robust = robust_start(dataset) if settings.loss == "robust" else None
    found = [pose for pose in (start, robust) if pose is not None]
    rays = dataset.rays.T
    return sorted(
        found,
        key=lambda pose: float(
            np.median(np.abs(residuals(pose.essential, rays[:, :2], rays[:, 2:])))
        ),
    )


def lenses_of(dataset: Dataset) -> FloatArray:
    """(2, 23): what of the two lenses stays: skew and distortion."""
    return np.array(
        [np.append(c.K[0, 1], lens_terms(c)) for c in (dataset.primary, dataset.secondary)]
    )


def robust_start(dataset: Dataset) -> Pose | None:
    """The pose of an essential matrix that ignores wrong pairs (MAGSAC++, from OpenCV)."""
    rays = dataset.rays
    if rays.shape[1] < 6:
        return None
    focal = float(np.sqrt(np.prod(dataset.pixel_scale[:, 0])))
    E, _ = cv2.findEssentialMat(
        np.ascontiguousarray(rays[:2].T), np.ascontiguousarray(rays[2:].T), np.eye(3),
        method=cv2.USAC_MAGSAC, prob=0.9999, threshold=2.0 / focal,
    )  # fmt: skip
    if E is None or np.shape(E) != (3, 3):
        return None
    R, t, in_front = choose_pose(np.asarray(E, dtype=np.float64), rays)
    return Pose(R, dataset.baseline_m * t) if in_front else None


def _solved(dataset: Dataset, start: Pose, settings: RefineSettings) -> _Adjustment | None:
    """The adjustment from one start; None if it leads nowhere."""
    adjustment = _Adjustment(dataset, start, settings)
    return adjustment if adjustment.run() else None


class _Adjustment:
    """The state of a solve: arrays that the compiled code reads and writes."""

    def __init__(self, dataset: Dataset, start: Pose, settings: RefineSettings) -> None:
        self.dataset, self.settings = dataset, settings
        self.unknowns = unknowns_of(dataset, start, settings)
        rows = dataset.correspondences
        self.frames = rows.frames
        at = np.searchsorted(self.frames, rows.frame)
        n = len(self.frames)
        self.pixels, self.rays = np.full((n, 2, 4), np.nan), np.full((n, 2, 4), np.nan)
        self.pixels[at, rows.target, :2], self.pixels[at, rows.target, 2:] = (
            rows.primary, rows.secondary,
        )  # fmt: skip
        self.rays[at, rows.target] = dataset.rays.T
        self.distances = np.full(n, np.nan)
        self.distances[at[rows.bars[:, 0]]] = dataset.bar_distances_m
        bar = np.isfinite(self.distances)
        self.targets = np.isfinite(self.pixels[:, :, 0]).sum(axis=1)
        self.freedom = self.targets + bar
        self.limit = chi2.isf(RARE, self.freedom)
        self.lenses = lenses_of(dataset)
        self.p = np.zeros(len(self.unknowns.names))
        self.places = np.full((n, OWN), np.nan)
        self.misfits = np.full(n, np.inf)
        self.H = np.zeros((SHARED, SHARED))
        self.smallest_scatter = SMALLEST_SCATTER * dataset.target_distance_m
        self.sigma_px = settings.sigma_px or 1.0
        self.scatter = max(settings.scatter_m or 0.0, self.smallest_scatter)
        self.outlying = np.zeros(n, dtype=np.bool_)
        self.cost, self.steps, self.converged = np.inf, 0, False

    @property
    def q(self) -> FloatArray:
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)

    def run(self) -> bool:
        """From the start to the end; false if no frame fits anywhere."""
        if self.settings.loss == "robust" and not self._come_down():
            return False
        for _ in range(MOST_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying.copy())
            self._solve(np.where(self.outlying, 0.0, np.inf))
            if not np.isfinite(self.cost) or not self._estimate_noise():
                return False
            if self.settings.loss == "robust":
                self.outlying = ~(self.misfits * self._change(before) <= self.limit)
            if self._settled(before):
                break
        self._solve(np.where(self.outlying, 0.0, np.inf))
        return bool(np.isfinite(self.cost))

    def better_than(self, other: _Adjustment) -> bool:
        """Whether frames fit better here, all measured by the smaller noise of the two."""
        noise = min(self.sigma_px, other.sigma_px)
        own, its = (
            float(np.minimum(a.misfits * (a.sigma_px / noise) ** 2, a.limit).sum())
            for a in (self, other)
        )
        return own < its

    def _come_down(self) -> bool:
        """The biweight with a limit that comes down to its place, noise by medians."""
        for _ in range(MOST_ROUNDS):
            before = (self.sigma_px, self.scatter, self.outlying)
            if not self._estimate_noise(robust=True):
                return False
            self._evaluate(self.limit)
            scale = float(np.median(self.misfits / MEDIANS[self.freedom]))
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

    def _settled(
        self, before: tuple[float, float, npt.NDArray[np.bool_]], same: float = SAME_NOISE
    ) -> bool:
        sigma, scatter, outlying = before
        return (
            abs(self.sigma_px - sigma) <= same * sigma
            and abs(self.scatter - scatter) <= max(same * scatter, 0.1 * self.smallest_scatter)
            and bool((outlying == self.outlying).all())
        )

    def _change(self, before: tuple[float, float, Any]) -> float:
        """Factor of a misfit that was found with the noise of `before`."""
        return (before[0] / self.sigma_px) ** 2

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
        if self.settings.sigma_px is None:
            if robust:
                ratio = float(np.median(misfits / MEDIANS[self.targets]))
            else:
                good = ~self.outlying & np.isfinite(misfits)
                left = float(self.targets[good].sum()) - spent_px
                ratio = float(misfits[good].sum()) / max(left, 1.0)
            if not np.isfinite(ratio):
                return False
            self.sigma_px = max(self.sigma_px * np.sqrt(ratio), SMALLEST_SIGMA_PX)
        if self.settings.scatter_m is None:
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

    def result(self, seconds: float) -> RefinedResult:
        q = self.q
        seen = np.isfinite(self.pixels[:, :, :1])
        return RefinedResult(
            dataset=self.dataset,
            settings=self.settings,
            pose=Pose.from_angles(Angles(*q[: EPSILON + 1].tolist()), float(q[BASELINE])),
            primary=camera_of(self.dataset.primary, q[PRIMARY : PRIMARY + 4]),
            secondary=camera_of(self.dataset.secondary, q[SECONDARY : SECONDARY + 4]),
            unknowns=self.unknowns,
            p=self.p,
            information=self.H,
            sigma_px=Noise(self.sigma_px, GIVEN if self.settings.sigma_px else ESTIMATED),
            scatter_m=Noise(
                self.scatter, ESTIMATED if self.settings.scatter_m is None else GIVEN
            ),
            frames=self.frames,
            misfits=self.misfits,
            freedom=self.freedom,
            outlying=self.outlying,
            places_m=np.where(seen, self.places.reshape(-1, 2, 3), np.nan),
            cost=float(self.cost),
            steps=self.steps,
            stop_reason="converged" if self.converged else "the largest number of steps was reached",
            seconds=seconds,
        )


def scatter_of(
    innovations: FloatArray, variances: FloatArray, spent: float = 0.0, robust: bool = False
) -> float:
    """The scatter that explains the lengths beyond the noise of the pixels, in metres.

    Solves sum(e^2 / (scatter^2 + v)) = n - spent (Mandel and Paule), or, `robust`, the same for the
    median of a squared normal number. 0 where the pixels explain all.

    Args:
        innovations: (n,), e, reconstructed less stated lengths, in metres.
        variances: (n,), v, from the pixels, in square metres.
        spent: how many lengths went into the unknowns.
    """
    squares = np.square(innovations)
    if len(squares) < 2:
        return 0.0

    def excess(square: float) -> float:
        terms = squares / (square + variances)
        if robust:
            return float(np.median(terms)) / float(MEDIANS[1]) - 1.0
        return float(terms.sum()) / max(len(terms) - spent, 1.0) - 1.0

    low, high = 0.0, float(squares.max()) * max(len(squares), 10)
    if not excess(1e-300) > 0:
        return 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if excess(middle) > 0 else (low, middle)
    return float(np.sqrt(high))
