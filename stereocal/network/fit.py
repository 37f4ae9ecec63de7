"""The joint adjustment of a rig: the robust fit of `refined.robust` over N views.

A rig of two cameras has the same residuals and priors as the pair's refined method.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stereocal.network.placings import placings_of
from stereocal.network.unknowns import (
    RigSettings,
    baseline_equations,
    baselines_of,
    turned,
    unknowns_of,
)
from stereocal.network.views import EACH, length_innovations, sum_normal_equations
from stereocal.refined.adjustment import TOLERANCE
from stereocal.refined.distortion import lens_terms
from stereocal.refined.robust import (
    ASSUMED,
    ASSUMED_PX,
    ESTIMATED,
    MINIMUM_BARS,
    MINIMUM_PAIRS,
    SMALLEST_SCATTER,
    RobustFit,
)
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording


class RigFit(RobustFit):
    """A fit from first poses: the arrays that the compiled code reads and writes."""

    def __init__(
        self,
        recording: Recording,
        poses: Sequence[Pose],
        settings: RigSettings,
        motion: FloatArray | None = None,
        loss: RefineSettings | None = None,
    ) -> None:
        self.recording, self.rig_settings = recording, settings
        self.settings = loss or RefineSettings()
        self.placings = placings_of(recording)
        seen, cameras = self.placings.seen, list(recording.cameras.values())
        self.frames, bars = self.placings.frames, self.placings.bars
        self.unknowns = unknowns_of(recording, poses, settings, bool(bars.any()))
        self.baselines = baselines_of(recording, settings)
        self.R = np.array([pose.R for pose in poses])
        self.lenses = np.array([np.append(c.K[0, 1], lens_terms(c)) for c in cameras])
        self.free = np.asarray(self.unknowns.M.any(axis=1))
        self.rays = np.full(self.placings.pixels.shape, np.nan)
        for number, camera in enumerate(cameras):
            own = seen[:, :, number]
            self.rays[:, :, number][own] = camera.undistort(self.placings.pixels[:, :, number][own])
        self.motion = np.empty((0, 2, len(cameras), 2)) if motion is None else motion
        self.pixel_freedom = self.placings.pixel_freedom
        self.degrees_of_freedom = self.pixel_freedom + bars
        self.pixel_variance = np.ones(len(self.frames))
        self.limit = self.placings.limits(len(self.unknowns.names))
        self.p = np.zeros(len(self.unknowns.names))
        self.points = np.full((len(seen), 6), np.nan)
        self.chi_squares = np.full(len(self.frames), np.inf)
        count = len(self.unknowns.origin)
        self.H = np.zeros((count, count))
        longest = float(recording.object.distances.max())
        self.smallest_scatter = SMALLEST_SCATTER * longest
        self.sigma_px, self.scatter = ASSUMED_PX, self.smallest_scatter
        self.source_px = ESTIMATED if seen.sum() >= 2 * MINIMUM_PAIRS else ASSUMED
        self.source_scatter = ESTIMATED if bars.sum() >= MINIMUM_BARS else ASSUMED
        self.outlying = np.zeros(len(self.frames), dtype=np.bool_)
        self.is_near = False
        self.cost, self.steps, self.converged = np.inf, 0, False

    @property
    def has_parts(self) -> bool:
        return len(self.placings.of_frame) > len(self.frames)

    @property
    def q(self) -> FloatArray:
        """(Q,): the unknowns of `views`; the small rotations are 0, for they are in R."""
        return np.asarray(self.unknowns.origin + self.unknowns.M @ self.p)

    @property
    def poses(self) -> list[Pose]:
        """`camera_from_reference` of each camera."""
        T = self.q[:-1].reshape(-1, EACH)[:, 3:6]
        return [Pose(R, own) for R, own in zip(self.R, T, strict=True)]

    @property
    def information(self) -> FloatArray:
        """(Q, Q): of images, lengths and baselines, without the other priors."""
        return self.H + baseline_equations(self.baselines, self.q, self.R)[1]

    def start_at(self, p: Mapping[str, float], sigma_px: float) -> None:
        """Start where another fit ended, as far as it has the same free parameters."""
        found = np.array([p.get(name, 0.0) for name in self.unknowns.names])
        self.p = np.where(self._within(6), 0.0, found)  # the poses are in the first ones
        self.sigma_px = sigma_px if self.source_px == ESTIMATED else self.sigma_px

    def equations(
        self, q: FloatArray, groups: Sequence[IntArray], free: BoolArray | None = None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        n, count = len(groups), len(q)
        H, g, c = np.zeros((n, count, count)), np.zeros((n, count)), np.zeros(n)
        for i, own in enumerate(groups):
            units = np.flatnonzero(np.isin(self.placings.of_frame, own))
            c[i] = self._equations_of(
                q, units, own, self.free if free is None else free, H[i], g[i]
            )
        lost = ~np.isfinite(c)
        H[lost], g[lost], c[lost] = 0.0, 0.0, 0.0
        return H, g, c

    def _equations_of(
        self,
        q: FloatArray,
        units: IntArray,
        frames: IntArray,
        free: BoolArray,
        H: FloatArray,
        g: FloatArray,
    ) -> float:
        order = np.sort(frames)
        return sum_normal_equations(
            q,
            self.R,
            self.lenses,
            free,
            np.searchsorted(order, self.placings.of_frame[units]),
            self.placings.pixels[units],
            self.rays[units],
            self.motion[units] if len(self.motion) else self.motion,
            self.placings.distances[units],
            1 / self.sigma_px,
            1 / self.scatter,
            np.full(len(order), np.inf),
            np.array(self.points[units]),
            np.empty(len(order)),
            H,
            g,
        )

    def _call(
        self,
        q: FloatArray,
        R: FloatArray,
        length_weight: float,
        limits: FloatArray,
        points: FloatArray,
        chi_squares: FloatArray,
        H: FloatArray,
        g: FloatArray,
    ) -> float:
        own = self.placings
        return sum_normal_equations(
            q,
            R,
            self.lenses,
            self.free,
            own.of_frame,
            own.pixels,
            self.rays,
            self.motion,
            own.distances,
            1 / self.sigma_px,
            length_weight,
            limits,
            points,
            chi_squares,
            H,
            g,
        )

    def _sum(
        self,
        length_weight: float,
        limits: FloatArray,
        points: FloatArray,
        chi_squares: FloatArray,
        H: FloatArray,
    ) -> None:
        g = np.empty(len(H))
        self._call(self.q, self.R, length_weight, limits, points, chi_squares, H, g)

    def _innovations(self, points: FloatArray) -> FloatArray:
        own, found = self.placings, np.empty((len(points), 2))
        weight = 1 / self.sigma_px
        length_innovations(
            self.q, self.R, self.lenses, own.pixels, own.distances, weight, points, found
        )
        return np.asarray(found[np.isfinite(found[:, 0]) & ~self.outlying[own.of_frame]])

    def _solve(self, limits: FloatArray, tolerance: float = TOLERANCE) -> None:
        """Levenberg-Marquardt, with the steps of `adjustment.adjust`."""
        M, precision = self.unknowns.M, self.unknowns.precision
        p, R, points = self.p, self.R, self.points.copy()
        chi_squares, H, g = np.empty(len(limits)), np.empty_like(self.H), np.empty(len(self.H))
        self.cost, gain, damping = np.inf, np.inf, 1e-5
        self.converged = False
        A, b = np.empty(0), np.empty(0)
        for step in range(self.settings.maximum_steps + 1):
            q = self.unknowns.origin + M @ p
            cost = self._call(q, R, 1 / self.scatter, limits, points, chi_squares, H, g)
            of_baselines, H_baselines, g_baselines = baseline_equations(self.baselines, q, R)
            cost += of_baselines + float(p @ precision @ p)
            if cost <= self.cost or step == 0:
                self.cost, self.p, self.R = cost, p, R
                self.points[:], self.chi_squares[:], self.H[:] = points, chi_squares, H
                A = M.T @ (H + H_baselines) @ M + precision
                b = M.T @ (g + g_baselines) + precision @ p
                damping *= 0.05 if step else 1.0
                if gain < tolerance:
                    self.converged = True
            else:
                points[:] = self.points
                damping = max(20.0 * damping, 1e-4)
                self.converged = gain < 1e-6
            self.steps += 1
            if self.converged or not np.isfinite(self.cost):
                return
            try:
                L = np.linalg.cholesky(A + damping * np.diag(np.diag(A)))
            except np.linalg.LinAlgError:
                return
            half = np.linalg.solve(L, b)
            gain = float(half @ half)
            moved = self.p - np.linalg.solve(L.T, half)
            R = turned(self.R, self.unknowns.origin + M @ moved)
            p = np.where(self._within(3), 0.0, moved)

    def _within(self, first: int) -> BoolArray:
        """(k,): the free parameters among a camera's `first` ones: 3 rotations, 6 of the pose."""
        places = np.arange(len(self.unknowns.origin)) % EACH < first
        places[-1] = False
        return np.asarray(self.unknowns.M[places].any(axis=0))
