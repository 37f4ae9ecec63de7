"""The results of all methods on a data set, with the frames that were left out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from stereocal.calibration.methods import CalibrationSettings, Errors, FileMethod, Method, errors_of
from stereocal.calibration.montecarlo import MethodResult
from stereocal.errors import StereocalError
from stereocal.fit.errors.disagreement import InputComparison, compare_inputs
from stereocal.fit.errors.stated_inputs import Input
from stereocal.fit.parameter_file import refined_parameters
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.screening.screen import Screening
from stereocal.rig.geometry import triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.rig.parameters import ForecastEntries, RigParameters, about_data
from stereocal.rig.volume import Volume
from stereocal.system.array_types import IntArray
from stereocal.system.latest import step


@dataclass(frozen=True, eq=False)
class Calibration:
    """The results of all methods, with their data and settings."""

    dataset: Pair
    settings: CalibrationSettings
    screening: Screening
    """The frames that were left out because they contradict the others."""
    frames: IntArray
    """Numbers of the frames used for calibration."""
    methods: Mapping[Method, MethodResult]
    warnings: tuple[str, ...]
    """Messages for the user."""
    refined: RefinedResult | None = None
    """None if the refined method was not requested or failed."""
    out_of_step: bool = False
    """Whether a warning offers to solve for a time offset."""
    focal_changes: bool = False
    """Whether a warning says that a focal length changes with the distance: no input is accused."""

    @cached_property
    def held_out_frames(self) -> IntArray:
        """Numbers of the frames used neither for calibration nor left out by the screening."""
        return np.setdiff1d(self.screening.dataset.correspondences.frames, self.frames)

    @property
    def fitted(self) -> Pair:
        """The data set of `frames`."""
        kept = self.screening.dataset
        if len(self.frames) == len(kept.correspondences.frames):
            return kept
        return kept.of_frames(self.frames)

    @cached_property
    def errors(self) -> Mapping[Method, Errors]:
        """Errors of each set on all frames, of the refined one with its own lenses."""
        left_out = self.screening.left_out
        errors = {
            name: errors_of(self.dataset, result.pose, left_out)
            for name, result in self.methods.items()
        }
        if self.refined is not None:
            seen = self.refined.apply(self.dataset)
            errors["refined"] = errors_of(seen, self.refined.pose, left_out)
        return errors

    @step
    def comparison(self) -> InputComparison | None:
        """What the images say of each stated input; None without a refined set."""
        return None if self.refined is None else compare_inputs(self.refined)

    @property
    def inputs(self) -> list[Input]:
        """Which input values the images contradict; empty without a refined set."""
        inputs = [] if self.comparison is None else self.comparison.inputs
        return [replace(item, accused=False) for item in inputs] if self.focal_changes else inputs

    @property
    def noise_px(self) -> float | None:
        """Standard deviation of an image coordinate by the refined or the screening's fit."""
        if self.refined is not None:
            return float(self.refined.sigma_px.value)
        return self.screening.noise_px

    def parameters(
        self,
        method: FileMethod,
        validation: Mapping[str, Any] | None = None,
        forecast: ForecastEntries | None = None,
    ) -> RigParameters:
        """The parameter set to save: `2d` to match with, `3d` to measure with, `refined` for both.

        Args:
            validation: figures of a validation of this data set.
            forecast: figures on frames to come; their threshold is the recommended one if there is
                no validation.
        """
        if method == "refined":
            if self.refined is None:
                raise StereocalError("There is no refined set: `warnings` has the reason, if any.")
            left_out = self.screening.left_out
            return refined_parameters(
                self.refined, self.inputs, validation, left_out, forecast, self.dataset
            )
        result = self.methods[method]
        used = np.isin(self.dataset.correspondences.frame, self.frames)
        points = triangulate_rays(result.pose.R, result.pose.T, self.dataset.rays[:, used])
        return RigParameters(
            method=method,
            primary=self.dataset.primary,
            secondary=self.dataset.secondary,
            pose=result.pose,
            cost=result.cost,
            settings=self.settings.to_json(),
            uncertainties=forecast.uncertainties if forecast else None,
            frames_left_out=self.screening.left_out,
            noise_px=self.noise_px,
            volume=Volume.of_bars(points),
            **about_data(self.dataset, self.frames, self.screening.shift, validation, forecast),
        )
