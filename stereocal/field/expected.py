"""What the refined set of a planned recording will be worth, without a simulation.

The refined method is solved once on the noise-free images of many bars; its information, scaled to
the planned number of frames, and the stated uncertainties give the covariance of the cameras, and
with the noise of the images that of every point and length. Variants of the plan cost milliseconds.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.bars import place_planned_bars
from stereocal.field.common_view import common_points
from stereocal.field.plan import Plan
from stereocal.refined.refine import RefinedResult, refine
from stereocal.refined.solve import lenses_of_cameras
from stereocal.refined.uncertainty import (
    distance_sigmas,
    length_jacobian,
    point_covariances,
)
from stereocal.refined.unknowns import LensPrior, RefineSettings, shared_unknowns
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.dataset import Correspondences, Dataset
from stereocal.verdict.judging import photograph

BARS = 120
"""Bars of the noise-free fit; 60 and 240 change the errors by a few per cent."""
DEPTHS = 9
MEAN_OF_NORMAL = float(np.sqrt(2 / np.pi))
"""Mean absolute value over standard deviation of a normal error."""


@dataclass(frozen=True, eq=False)
class ExpectedFit:
    """The refined set to be expected of a plan."""

    plan: Plan
    result: RefinedResult
    """On noise-free images, with the information of the planned number of frames."""
    ends_m: FloatArray
    """(bars, 2, 3): the bars of the fit, on which lengths are judged too."""

    @cached_property
    def length_error(self) -> float:
        """Mean relative error of lengths like the bar's, in the volume."""
        return self.error_with(self.result.information, self.result.unknowns.precision)

    def error_with(
        self, information: FloatArray, precision: FloatArray, noise: float = 1.0
    ) -> float:
        """The length error with another knowledge of the cameras.

        Args:
            information: (23, 23), of images and bars.
            precision: (k, k), of the priors.
            noise: factor of the noise of the points that are measured.
        """
        M = self.result.unknowns.M
        A = M.T @ information @ M + precision
        scale = 1.0 / np.sqrt(np.diag(A))
        C = np.linalg.inv(A * np.outer(scale, scale)) * np.outer(scale, scale)
        J = self._jacobian @ M
        variance = noise**2 * self._own_variance + np.einsum("ni,ij,nj->n", J, C, J)
        return MEAN_OF_NORMAL * float(np.mean(np.sqrt(variance))) / self.plan.bar_m

    def information_of(self, among: BoolArray) -> FloatArray:
        """(23, 23): the information of one frame, on average over some of the bars (n,)."""
        found = refine(
            self.result.dataset, self.result.settings, self.plan.pose, np.repeat(among, 2)
        )
        return np.asarray(found.information / int(among.sum()))

    def precision_knowing(self, better: Mapping[str, float]) -> FloatArray:
        """(k, k): the precision of the priors with smaller standard deviations.

        Args:
            better: factors of the standard deviations, by the first word of an unknown's name:
                primary, secondary, baseline, bar.
        """
        unknowns = self.result.unknowns
        factors = np.array([better.get(name.split()[0], 1.0) for name in unknowns.names])
        return np.asarray(unknowns.precision / np.outer(factors, factors))

    @cached_property
    def by_depth(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Depths in m, and there the mean length error (a fraction) and position error (m); NaN
        where the cameras see nothing in common.
        """
        plan = self.plan
        depths = np.linspace(plan.near_m, plan.far_m, DEPTHS)
        length, position = np.full(DEPTHS, np.nan), np.full(DEPTHS, np.nan)
        for at, depth in enumerate(depths):
            try:
                points = common_points(plan.rig, (float(depth), float(depth)))
            except StereocalError:
                continue
            points = np.unique(points, axis=0)[:: max(len(points) // 400, 1)]
            halves = 0.5 * plan.bar_m * np.eye(3)
            sigmas = [distance_sigmas(self.result, points - h, points + h) for h in halves]
            length[at] = MEAN_OF_NORMAL * np.nanmean(sigmas) / plan.bar_m
            covariances = point_covariances(self.result, points)
            position[at] = np.nanmean(np.sqrt(np.trace(covariances, axis1=1, axis2=2)))
        return depths, length, position

    @cached_property
    def _jacobian(self) -> FloatArray:
        return length_jacobian(self.result, self.ends_m[:, 0], self.ends_m[:, 1])

    @cached_property
    def _own_variance(self) -> FloatArray:
        """(bars,): variance of the lengths by the noise of their own points."""
        whole = distance_sigmas(self.result, self.ends_m[:, 0], self.ends_m[:, 1]) ** 2
        J = self._jacobian
        return np.asarray(whole - np.einsum("ni,ij,nj->n", J, self.result.covariance, J))


def expect(plan: Plan, seed: int = 0, bars: int = BARS) -> ExpectedFit:
    """The refined set to be expected of a plan.

    Raises:
        StereocalError: the bar hardly fits, or the bars do not determine the cameras.
    """
    ends = place_planned_bars(plan, bars, np.random.default_rng([seed, 1]))
    pixels = np.empty((2 * bars, 4))
    lenses = lenses_of_cameras(plan.primary, plan.secondary)
    photograph(shared_unknowns(plan.rig), lenses, ends.reshape(-1, 3), pixels)
    dataset = planned_dataset(plan, pixels)
    found = refine(dataset, refine_settings(plan), plan.pose)
    information = found.information * plan.frames / bars
    return ExpectedFit(plan, replace(found, information=information), ends)


def planned_dataset(plan: Plan, pixels: FloatArray) -> Dataset:
    """The data set of a recording, calibrated as stated.

    Args:
        pixels: (2 frames, 4): u, v of the primary and the secondary, of A and B in turn.

    Raises:
        StereocalError: a point is outside its image.
    """
    frames = len(pixels) // 2
    rows = Correspondences.from_arrays(
        np.repeat(np.arange(1, frames + 1), 2), "AB" * frames, pixels[:, :2], pixels[:, 2:]
    )
    return Dataset(plan.name, plan.primary, plan.secondary, rows, plan.baseline_m, plan.bar_m)


def refine_settings(plan: Plan) -> RefineSettings:
    """The settings of who knows the uncertainties of the plan."""
    own = plan.uncertainty
    lens = LensPrior(own.focal, own.centre_px)
    return RefineSettings(
        primary=lens,
        secondary=lens,
        baseline_sigma_m=own.baseline_m,
        distance_sigma_m=own.bar_m,
        sigma_px=plan.noise_px,
        scatter_m=0.0,
        loss="squares",
    )
