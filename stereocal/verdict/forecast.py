"""The forecast of all files of a calibration, and the model that it comes from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.errors import StereocalError
from stereocal.refined.disagreement import Comparison, compare_inputs
from stereocal.refined.parameter_file import covariance_entry
from stereocal.refined.refine import RefinedResult
from stereocal.refined.results import Calibration
from stereocal.refined.two_views import BAR
from stereocal.refined.unknowns import shared_unknowns, unknowns_between
from stereocal.rig.compiled import FloatArray
from stereocal.rig.parameters import FileForecast
from stereocal.rig.rig import Rig
from stereocal.verdict.improvements import advice_on_improvements
from stereocal.verdict.model_check import ModelCheck, check_model
from stereocal.verdict.one_or_two_sets import Verdict, verdict
from stereocal.verdict.predictive import Predictive, predict


@dataclass(frozen=True, eq=False)
class Outlook:
    """The forecast of all files of a calibration."""

    files: Mapping[Method, Rig]
    refined: RefinedResult
    comparison: Comparison
    predictive: Predictive
    check: ModelCheck | None
    """Whether held-out frames agree with the forecast; None with too few frames."""

    @cached_property
    def verdict(self) -> Verdict:
        """Whether two sets are needed, and which files to use."""
        frames = len(self.refined.dataset.correspondences.frames)
        return verdict(self.predictive, frames, self.check)

    @cached_property
    def advice(self) -> str:
        """What would lower the errors of the refined set."""
        return advice_on_improvements(self.comparison.model)

    def of_file(self, method: Method, threshold_px: float | None = None) -> FileForecast:
        """The entries of one parameter file.

        Args:
            threshold_px: at which the shares are given; None: the recommended one.
        """
        model, predictive = self.comparison.model, self.predictive
        forecast = predictive.forecast(method, threshold_px)
        return FileForecast(
            forecast.to_json(),
            {
                "sigma_px": {"value": float(model.sigma_px.value), "source": model.sigma_px.source},
                "bar_scatter_m": {
                    "value": float(model.scatter_m.value),
                    "source": model.scatter_m.source,
                },
                "covariance": covariance_entry(
                    self.covariance(method), (model.primary, model.secondary)
                ),
                "design_effect": model.design_effect,
            },
        )

    def of_files(self, validation: Mapping[Any, Mapping[str, Any]]) -> dict[Method, FileForecast]:
        """The entries of all files, with the shares at the thresholds of a validation, if any."""
        return {
            method: self.of_file(
                method, validation[method]["threshold_px"] if method in validation else None
            )
            for method in self.files
        }

    def covariance(self, method: Method) -> FloatArray:
        """(25, 25): mean square deviation of a file from the truth, of the shared unknowns.

        That of the model about the truth, and the deviation of the file from the model.
        """
        model = self.comparison.model
        away = unknowns_between(shared_unknowns(self.files[method]), model.q)
        away[BAR] = 0.0
        return np.asarray(model.covariance + np.outer(away, away))


def forecast_files(calibration: Calibration, seed: int = 0) -> Outlook:
    """Forecast the files of a calibration with its refined set."""
    refined = calibration.refined
    if refined is None:
        raise StereocalError("A forecast needs the refined method.")
    stated = calibration.dataset
    files: dict[Method, Rig] = {
        method: Rig(stated.primary, stated.secondary, found.pose)
        for method, found in calibration.methods.items()
    }
    files["refined"] = Rig(refined.primary, refined.secondary, refined.pose)
    comparison = compare_inputs(refined)
    predictive = predict(comparison.model, files, seed)
    check = check_model(refined, comparison.model, predictive)
    if check is not None and not check.holds:
        predictive = replace(predictive, excess=check.excess)
    return Outlook(files, refined, comparison, predictive, check)


def outlook_of(calibration: Calibration, seed: int = 0) -> Outlook | None:
    """The forecast, or None if there cannot be one."""
    try:
        return forecast_files(calibration, seed)
    except StereocalError:
        return None
