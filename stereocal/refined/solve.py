"""The solve of the refined method for a pair of cameras."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from stereocal.refined.adjustment import (
    TOLERANCE,
    adjust,
    length_innovations,
    sum_normal_equations,
)
from stereocal.refined.bar_fit import OWN, SEEN, SHARED, TIMED
from stereocal.refined.distortion import lens_terms
from stereocal.refined.robust import (
    ASSUMED,
    ASSUMED_PX,
    ESTIMATED,
    GIVEN,
    MINIMUM_BARS,
    MINIMUM_PAIRS,
    SMALLEST_SCATTER,
    RobustFit,
    limits_of,
)
from stereocal.refined.unknowns import ANGLES, RefineSettings, Unknowns, unknowns_of
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.rig.tracks import TimeOffset

OF_BAR = 3
"""Degrees of freedom of a bar."""


class Solve(RobustFit):
    """A solve from one initial pose: the arrays that the compiled code reads and writes.

    Those have a row for each part of a frame (`Correspondences.parts`): a bar is one part, the
    placing of an object several.
    """

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
        part, place = (own[kept] for own in table.parts)
        _, first, at = np.unique(part, return_index=True, return_inverse=True)
        self.frames, self.frame_of = np.unique(table.frame[kept][first], return_inverse=True)
        n = len(first)
        self.rays = np.full((n, 2, 4), np.nan)
        timed = settings.time_offset or settings.time_drift
        self.pixels = np.full((n, 2, TIMED if timed else SEEN), np.nan)
        self.pixels[at, place, :2] = table.primary[kept]
        self.pixels[at, place, 2:SEEN] = table.secondary[kept]
        if timed:
            offset = dataset.time_offset or TimeOffset()
            self.pixels[at, place, SEEN:6] = np.nan_to_num(table.motion[kept, :2])
            self.pixels[at, place, 6] = table.time_frame[kept] - offset.reference
        self.pixel_variance = np.ones((len(self.frames), len(table.names)))
        of_rows = self.frame_of[at], table.target[kept]
        self.pixel_variance[of_rows] = 0.5 + 0.5 * np.nan_to_num(table.motion[kept, 2], nan=1.0)
        self.rays[at, place] = dataset.rays[:, kept].T
        self.distances = np.full(n, np.nan)
        of_bars = at[np.searchsorted(np.flatnonzero(kept), table.bars[bars, 0])]
        self.distances[of_bars] = dataset.bar_distances_m[bars]
        bar = np.isfinite(self.distances)
        targets = np.isfinite(self.pixels[:, :, 0]).sum(axis=1)
        self.degrees_of_parts = targets + bar
        self.pixel_freedom = self._by_frame(targets).astype(np.int64)
        self.degrees_of_freedom = self._by_frame(self.degrees_of_parts).astype(np.int64)
        self.set_limits(len(self.unknowns.names))
        self.lenses = lenses_of(dataset)
        self.p = np.zeros(len(self.unknowns.names))
        self.points = np.full((n, OWN), np.nan)
        self.chi_squares, self._of_parts = np.full(len(self.frames), np.inf), np.full(n, np.inf)
        self.H = np.zeros((SHARED, SHARED))
        self.smallest_scatter = SMALLEST_SCATTER * dataset.target_distance_m
        self.sigma_px = settings.sigma_px or ASSUMED_PX
        self.scatter = max(settings.scatter_m or 0.0, self.smallest_scatter)
        self.source_px = self.source_scatter = GIVEN
        if settings.sigma_px is None:
            self.source_px = ESTIMATED if len(place) >= MINIMUM_PAIRS else ASSUMED
        if settings.scatter_m is None:
            self.source_scatter = ESTIMATED if bar.sum() >= MINIMUM_BARS else ASSUMED
        self.outlying = np.zeros(len(self.frames), dtype=np.bool_)
        self.is_near = False
        self.cost, self.steps, self.converged = np.inf, 0, False

    def set_limits(self, unknowns: int) -> None:
        """Set the limits of the chi-squares for a number of unknowns.

        The points of one placing of an object have errors that are alike: it is judged by their
        mean, as one bar.
        """
        of_bar = np.minimum(self.degrees_of_freedom, OF_BAR)
        self.limit = limits_of(of_bar, unknowns) * (self.degrees_of_freedom / of_bar)
        of_parts = limits_of(self.degrees_of_parts, unknowns)
        self._share_of_parts = of_parts / self.limit[self.frame_of]

    @property
    def has_parts(self) -> bool:
        return len(self.frame_of) > len(self.frames)

    def _by_frame(self, of_parts: npt.ArrayLike) -> FloatArray:
        """(f,): sums over the parts of each frame."""
        return np.asarray(np.bincount(self.frame_of, of_parts), dtype=np.float64)

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
        n, every = len(groups), np.arange(SHARED)
        H, g, c = np.zeros((n, SHARED, SHARED)), np.zeros((n, SHARED)), np.zeros(n)
        weights = 1 / self.sigma_px, 1 / self.scatter
        for i, group in enumerate(groups):
            own = group
            if self.has_parts:
                own = np.flatnonzero(np.isin(self.frame_of, group))
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
            limits[self.frame_of] * self._share_of_parts,
            self.points,
            self._of_parts,
            self.H,
            tolerance,
            self.settings.maximum_steps,
        )
        self.chi_squares[:] = self._by_frame(self._of_parts)
        self.steps += steps

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
            limits[self.frame_of] * self._share_of_parts,
            points,
            self._of_parts,
            H,
            np.empty(SHARED),
        )
        chi_squares[:] = self._by_frame(self._of_parts)

    def _innovations(self, points: FloatArray) -> FloatArray:
        found = np.empty((len(points), 2))
        length_innovations(
            self.q, self.lenses, self.pixels, self.distances, 1 / self.sigma_px, points, found
        )
        return np.asarray(found[np.isfinite(found[:, 0]) & ~self.outlying[self.frame_of]])


def lenses_of(dataset: Dataset) -> FloatArray:
    """(2, 23): skew and `lens_terms` of both cameras, as stated."""
    return lenses_of_cameras(dataset.primary, dataset.secondary)


def lenses_of_cameras(primary: Camera, secondary: Camera) -> FloatArray:
    """(2, 23): skew and `lens_terms` of both cameras."""
    return np.array([np.append(c.K[0, 1], lens_terms(c)) for c in (primary, secondary)])
