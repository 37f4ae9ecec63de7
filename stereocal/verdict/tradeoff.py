"""The trade-off between the paper's 2D and 3D cost: points of the Pareto curve.

The weighted sum of both costs is minimised for weights from the 2D cost alone to the 3D cost alone.
Each solve starts from the result of the previous weight, in both directions, and the better result
is kept. The points form the convex part of the Pareto curve. There are two curves: one over the
five angles with the stated lenses and the measured baseline, like the paper's sets, and one in
which lenses and baseline vary within their uncertainties.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from itertools import count
from typing import Any

import numpy as np

from stereocal.calibration.essential import calibrate_essential
from stereocal.calibration.montecarlo import reconstruction_problem, reprojection_problem
from stereocal.errors import StereocalError
from stereocal.refined.distortion import lenses_of_cameras
from stereocal.refined.two_views import rig_of, undistort_rays
from stereocal.refined.unknowns import FIXED_LENS, RefineSettings, Unknowns, unknowns_of_pair
from stereocal.rig.dataset import Dataset
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from stereocal.verdict.paper_costs import fill_errors, jacobian, sizes_of

POINTS = 25
MAXIMUM_LOG_WEIGHT = 3.0
"""log10 of the largest ratio of the two weights: they run from 1 : 1000 to 1000 : 1."""
SMOOTHING = 0.01
"""Errors below this fraction of the mean error count quadratically, which makes |e| smooth at 0."""
MAXIMUM_STEPS = 150
TOLERANCE = 1e-6
"""A solve ends when a step lowers the objective by a smaller fraction."""


@dataclass(frozen=True, eq=False)
class TradeOffPoint:
    """One point of a curve: a complete parameter set and its two costs."""

    share: float
    """Weight of the 3D cost in the weighted sum, 0 to 1."""
    cost_2d_px: float
    cost_3d_m: float
    rig: Rig
    lenses: str
    """`fixed` or `freed`."""


@dataclass(frozen=True, eq=False)
class TradeOff:
    """Both curves, ordered from the 2D cost alone to the 3D cost alone."""

    fixed: tuple[TradeOffPoint, ...]
    freed: tuple[TradeOffPoint, ...]


def trade_off(
    dataset: Dataset,
    settings: RefineSettings | None = None,
    points: int = POINTS,
    progress: Callable[[int, int], None] = lambda _done, _total: None,
) -> TradeOff:
    """Compute both curves of a data set.

    Args:
        settings: the uncertainties within which lenses and baseline vary.
        points: number of points of each curve.
        progress: called with the number of finished solves and of all solves; what it raises ends
            the work.
    """
    settings = replace(settings or RefineSettings(), time_offset=False, time_drift=False, rest=None)
    if not len(dataset.correspondences.bars):
        raise StereocalError("No frame has both targets A and B, so there is no 3D cost.")
    start = calibrate_essential(dataset.rays, dataset.baseline_m).pose
    as_stated = replace(settings, primary=FIXED_LENS, secondary=FIXED_LENS, baseline_sigma_m=0.0)
    steps = count(1)

    def solved() -> None:
        progress(next(steps), 4 * points)

    curves = []
    for lenses, own in (("fixed", as_stated), ("freed", settings)):
        unknowns = unknowns_of_pair(
            dataset, start, replace(own, distance_sigma_m=0.0), distortion=False
        )
        curves.append(_Curve(dataset, unknowns, lenses).trace(points, solved))
    return TradeOff(*curves)


class _Curve:
    """The computation of one curve: data and working arrays."""

    def __init__(self, dataset: Dataset, unknowns: Unknowns, lenses: str) -> None:
        self.dataset, self.unknowns, self.name = dataset, unknowns, lenses
        rows = dataset.correspondences
        self.lenses = lenses_of_cameras(dataset.primary, dataset.secondary)
        self.rays = dataset.rays.copy()
        self.pixels = np.column_stack([rows.primary, rows.secondary])
        self.inverse_jacobians = np.empty((len(rows), 2, 4))
        self.bars, self.distances = rows.bars, dataset.bar_distances_m
        of_images = self.lenses, self.pixels, self.rays, self.inverse_jacobians
        self.data = *of_images, self.bars, self.distances
        n, m = len(rows), len(rows.bars)
        self.pairs = n
        self.errors = np.empty(4 * n + m)
        self.steps = np.where(np.isfinite(unknowns.sigma), 1e-4 * unknowns.sigma, 1e-6)
        p = np.zeros(len(unknowns.names))
        cost_2d, cost_3d = self._costs_at(p)
        if not np.isfinite(cost_2d + cost_3d):
            raise StereocalError("The trade-off cannot start: a point is behind a camera.")
        self.mean_px, self.mean_m = max(cost_2d / (2 * n), 1e-9), max(cost_3d / m, 1e-12)
        # The 3D cost is scaled by the errors at its own end of the curve, not at this end.
        end = self._minimise(p, 1.0 - 1e-3)
        self.mean_m = max(self._costs_at(end)[1] / m, 1e-12)
        self.ends = (p, end)

    def trace(self, points: int, solved: Callable[[], None]) -> tuple[TradeOffPoint, ...]:
        """All points, each the better result of both directions; `solved` is called after each."""
        shares = 1.0 / (1.0 + 10.0 ** np.linspace(MAXIMUM_LOG_WEIGHT, -MAXIMUM_LOG_WEIGHT, points))
        best: dict[float, tuple[float, FloatArray]] = {}
        for p, order in zip(self.ends, (shares, shares[::-1]), strict=True):
            for share in order.tolist():
                p = self._minimise(p, share)
                value = self._objective(p, share)
                if share not in best or value < best[share][0]:
                    best[share] = (value, p)
                solved()
        return tuple(self._point(share, best[share][1]) for share in shares.tolist())

    def _costs_at(self, p: FloatArray) -> tuple[float, float]:
        """The 2D cost in pixels and the 3D cost in metres."""
        self._errors_at(p)
        px, m = sizes_of(self.errors, self.pairs)
        return float(px.sum()), float(m.sum())

    def _errors_at(self, p: FloatArray) -> None:
        q = self._q(p)
        self.errors[:] = np.nan
        if undistort_rays(q, self.lenses, self.pixels, self.rays, self.inverse_jacobians):
            fill_errors(q, self.lenses, self.rays, self.bars, self.distances, self.errors)
        else:
            self.rays[:] = self.dataset.rays

    def _q(self, p: FloatArray) -> FloatArray:
        return np.asarray(self.unknowns.origin + self.unknowns.M @ p)

    def _objective(self, p: FloatArray, share: float) -> float:
        """The weighted sum of both costs, in units of their mean errors, plus the priors."""
        self._errors_at(p)
        px, m = sizes_of(self.errors, self.pairs)
        smooth_px = np.hypot(px, SMOOTHING * self.mean_px)
        smooth_m = np.hypot(m, SMOOTHING * self.mean_m)
        of_px, of_m = 2.0 * (1.0 - share) / self.mean_px, 2.0 * share / self.mean_m
        self.weights = np.concatenate([np.repeat(of_px / smooth_px, 2), of_m / smooth_m])
        value = of_px * smooth_px.sum() + of_m * smooth_m.sum()
        return float(value + 0.5 * (p @ self.unknowns.precision @ p))

    def _minimise(self, p: FloatArray, share: float) -> FloatArray:
        """Iteratively reweighted least squares with Levenberg-Marquardt steps, from p."""
        best, damping, fresh = self._objective(p, share), 1e-6, True
        for _ in range(MAXIMUM_STEPS):
            if fresh:
                J = jacobian(self._q(p), self.unknowns.M, self.steps, *self.data)
                weighted = J * self.weights
                A = weighted @ J.T + self.unknowns.precision
                b = weighted @ self.errors + self.unknowns.precision @ p
            scale = 1.0 / np.sqrt(np.diag(A))
            lifted = A * np.outer(scale, scale) + damping * np.eye(len(p))
            trial = p - scale * np.linalg.solve(lifted, scale * b)
            value = self._objective(trial, share)
            fresh = value <= best
            damping = max(0.1 * damping, 1e-12) if fresh else 10.0 * damping
            ended = best - value < TOLERANCE * value if fresh else damping > 1e6
            if fresh:
                best, p = value, trial
            if ended:
                break
        self._errors_at(p)
        return p

    def _point(self, share: float, p: FloatArray) -> TradeOffPoint:
        rig = rig_of(self.dataset.primary, self.dataset.secondary, self._q(p))
        return TradeOffPoint(share, *self._costs_at(p), rig, self.name)


def costs_of(dataset: Dataset, rigs: Mapping[Any, Rig]) -> dict[Any, tuple[float, float]]:
    """2D cost in pixels and 3D cost in metres of other parameter sets, for the same figure."""
    found = {}
    for name, rig in rigs.items():
        own = replace(dataset, primary=rig.primary, secondary=rig.secondary)
        costs = reprojection_problem(own), reconstruction_problem(own)
        found[name] = (costs[0].cost(rig.pose), costs[1].cost(rig.pose))
    return found
