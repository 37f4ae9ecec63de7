"""What the refined set of a planned recording will be worth, without a simulation.

The refined method is solved once on the noise-free images of many bars; its information, scaled to
the planned number of frames, and the stated uncertainties give the covariance of the cameras, and
with the noise of the images that of every point and length. Variants of the plan cost milliseconds.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from stereocal.errors import StereocalError
from stereocal.field.planning.bars import place_planned_bars
from stereocal.field.planning.plan import Plan, common_points, sees
from stereocal.fit.errors import uncertainty
from stereocal.fit.least_squares.small_steps import baseline_direction, rig_at
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings, measured_baselines
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.camera import CAMERAS
from stereocal.rig.correspondences import Correspondences
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.verdict.judging import photograph

BARS = 120
"""Bars of the noise-free fit; 60 and 240 change the errors by a few per cent."""
DEPTHS, POINTS = 9, 60
"""Depths at which errors are stated, and points of the common view at each."""
MAP_SIZE = 32
WIDEST = 2.0
"""Standard deviations that hold more than 95 % of normal errors."""


@dataclass(frozen=True, eq=False)
class ExpectedFit:
    """The refined set to be expected of a plan."""

    plan: Plan
    result: RefinedResult
    """On noise-free images, with the information of the planned number of frames."""
    ends_m: FloatArray
    """(bars, 2, 3): the bars of the fit, on which lengths are judged too."""

    @cached_property
    def length_p95(self) -> float:
        """The relative error that 95 % of lengths like the bar's are within, in the volume."""
        return self.length_p95_with(self.result.information, self.result.unknowns.precision)

    def length_p95_with(
        self, information: FloatArray, precision: FloatArray, noise: float = 1.0
    ) -> float:
        """The error of `length_p95` with another knowledge of the cameras.

        Args:
            information: (33, 33), of images and bars.
            precision: (k, k), of the priors.
            noise: factor of the noise of the points that are measured.
        """
        variances, jacobian = self._of_bars
        variances = noise**2 * variances
        return within_95(self._relative_sigmas(variances, jacobian, information, precision))

    def _relative_sigmas(
        self,
        variances: FloatArray,
        jacobian: FloatArray,
        information: FloatArray,
        precision: FloatArray,
    ) -> FloatArray:
        unknowns = replace(self.result.unknowns, precision=precision)
        C, J = unknowns.covariance(information), jacobian @ unknowns.M
        return np.asarray(np.sqrt(variances + np.einsum("ni,ni->n", J @ C, J)))

    def information_of(self, among: BoolArray) -> FloatArray:
        """(33, 33): the information of one frame, on average over some of the bars (n,)."""
        refined = refine(
            self.result.dataset, self.result.settings, self.plan.pose, np.repeat(among, 2)
        )
        return np.asarray(refined.information / int(among.sum()))

    def precision_knowing(self, better: Mapping[str, float]) -> FloatArray:
        """(k, k): the precision of the priors with standard deviations smaller by these factors, by
        the first word of an unknown's name (primary, secondary, object), and of the baseline."""
        unknowns = self.result.unknowns
        factors = np.array([better.get(name.split()[0], 1.0) for name in unknowns.names])
        sigma = measured_baselines(self.result.dataset.recording, self.result.settings)[0, 3]
        along = baseline_direction(self.result.at) @ unknowns.M / sigma
        of_baseline = np.outer(along, along)
        others = (unknowns.precision - of_baseline) / np.outer(factors, factors)
        return np.asarray(others + of_baseline / better.get("baseline", 1.0) ** 2)

    @cached_property
    def by_depth(self) -> "ByDepth":
        """The errors by depth."""
        plan = self.plan
        depths = np.linspace(plan.near_m, plan.far_m, DEPTHS)
        mean, p95, position = np.full((3, DEPTHS), np.nan)
        for k, depth in enumerate(depths):
            try:
                points = common_points(plan.rig, depths[k : k + 1])
            except StereocalError:
                continue
            points = points * (depth / points[:, 2:])
            away, sigmas = self.errors_at(points[:: max(len(points) // POINTS, 1)])
            mean[k] = uncertainty.MEAN_OF_NORMAL * np.nanmean(sigmas)
            p95[k], position[k] = within_95(sigmas), np.nanmean(away)
        return ByDepth(depths, mean, p95, position)

    def errors_at(self, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Standard errors of points in m, (n,): the root of the sum of three variances; and of
        lengths like the bar's in the middle of which they are, a fraction, (3, n): in three
        directions.
        """
        halves = 0.5 * self.plan.bar_m * np.eye(3)
        H, P = self.result.information, self.result.unknowns.precision
        lengths = [
            self._relative_sigmas(*self._relative_errors(points_m - h, points_m + h), H, P)
            for h in halves
        ]
        covariances = uncertainty.point_covariances(self.result, points_m)
        away = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
        return np.asarray(away), np.array(lengths)

    @cached_property
    def maps(self) -> list[uncertainty.AccuracyMap]:
        """Errors by place, from above and from the side."""
        return [self._map("above"), self._map("side")]

    def _map(self, plane: uncertainty.Plane) -> uncertainty.AccuracyMap:
        """Errors in the part of a plane of the volume that both cameras see: at the height of the
        primary camera (`above`) or straight ahead of it (`side`), or, where they see nothing of it,
        through the middle of the common view."""
        plan, points = self.plan, self.plan.common_points
        axis, across = (1, 0) if plane == "above" else (0, 1)
        inside = points[:, axis].min() <= 0.0 <= points[:, axis].max()
        level = 0.0 if inside else float(np.median(points[:, axis]))
        u = np.linspace(points[:, across].min(), points[:, across].max(), MAP_SIZE)
        z = np.linspace(plan.near_m, plan.far_m, MAP_SIZE)
        grid = np.full((MAP_SIZE**2, 3), level)
        grid[:, [across, 2]] = np.stack([*np.meshgrid(u, z)], axis=-1).reshape(-1, 2)
        seen = sees(plan.primary, grid) & sees(plan.secondary, plan.pose.apply(grid))
        away, length = np.full(len(grid), np.nan), np.full(len(grid), np.nan)
        if seen.any():
            away[seen], lengths = self.errors_at(grid[seen])
            length[seen] = lengths.mean(axis=0)
        point_m, relative = (errors.reshape(MAP_SIZE, MAP_SIZE) for errors in (away, length))
        return uncertainty.AccuracyMap(plane, level, u, z, point_m, relative)

    @cached_property
    def _of_bars(self) -> tuple[FloatArray, FloatArray]:
        return self._relative_errors(self.ends_m[:, 0], self.ends_m[:, 1])

    def _relative_errors(
        self, first_m: FloatArray, second_m: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Variances of lengths by the noise of their own points (n,), and the derivatives (n, 33)
        of length errors by the errors of the unknowns, all relative.
        """
        cameras, noise_px = self.result.at, self.result.sigma_px.value
        variances, jacobian = uncertainty.length_variances(cameras, noise_px, first_m, second_m)
        lengths = np.linalg.norm(first_m - second_m, axis=1)
        return np.asarray(variances / lengths**2), np.asarray(jacobian / lengths[:, None])


@dataclass(frozen=True, eq=False)
class ByDepth:
    """Errors by depth, (d,) each; NaN where the cameras see nothing in common."""

    depths_m: FloatArray
    mean_length: FloatArray
    """The mean relative error of lengths like the bar's."""
    length_p95: FloatArray
    """What 95 % of them are within."""
    position_m: FloatArray
    """The mean standard error of points."""


def within_95(sigmas: FloatArray) -> float:
    """What 95 % of normal errors are within whose standard deviations differ; NaN if none is
    known."""
    finite = sigmas[np.isfinite(sigmas)]
    if not len(finite):
        return float("nan")

    def outside(limit: float) -> float:
        return float(2.0 * ndtr(-limit / finite).mean()) - 0.05

    return float(brentq(outside, 0.0, WIDEST * finite.max()))


def expect(plan: Plan, seed: int = 0) -> ExpectedFit:
    """The refined set to be expected of a plan."""
    ends = place_planned_bars(plan, BARS, np.random.default_rng([seed, 1]))
    pixels = np.empty((2 * BARS, 4))
    photograph(rig_at(plan.rig), ends.reshape(-1, 3), pixels)
    dataset = planned_dataset(plan, pixels)
    refined = refine(dataset, plan_settings(plan), plan.pose)
    information = refined.information * plan.frames / BARS
    return ExpectedFit(plan, replace(refined, information=information), ends)


def planned_dataset(plan: Plan, pixels: FloatArray) -> Pair:
    """The data set of a recording as stated; pixels (2 frames, 4) of A and B in turn."""
    frames = len(pixels) // 2
    rows = Correspondences.from_arrays(
        np.repeat(np.arange(1, frames + 1), 2), "AB" * frames, pixels[:, :2], pixels[:, 2:]
    )
    recording = Recording.of_two(
        plan.name, plan.primary, plan.secondary, plan.baseline_m, plan.bar_m
    )
    return recording.holding(rows).pair(*CAMERAS)


def plan_settings(plan: Plan) -> RefineSettings:
    """Settings with the plan's uncertainties as priors."""
    sigma = plan.uncertainty
    lens = LensPrior(sigma.focal, sigma.centre_px)
    return RefineSettings(
        lenses=dict.fromkeys(CAMERAS, lens),
        baseline_sigma_m=sigma.baseline_m,
        distance_sigma_m=sigma.bar_m,
        sigma_px=plan.noise_px,
        scatter_m=0.0,
        loss="squares",
    )
