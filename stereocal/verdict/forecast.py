"""The forecast of all files of a calibration, the model it comes from, and what would improve it.

For that, the forecast of the refined set is repeated with a distribution of the truth that is as
narrow as the improvement would make it.
"""

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
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.parameters import FileForecast
from stereocal.rig.rig import Rig
from stereocal.system.numbers import rounded
from stereocal.verdict.model_check import ModelCheck, check_model
from stereocal.verdict.one_or_two_sets import Verdict, verdict
from stereocal.verdict.predictive import Predictive, predict

DRAWS, BARS = 32, 100
"""For improvements."""
KNOWN = 1e6
"""Factor of the information about a parameter that is known exactly."""
MORE_FRAMES = 4
WORTH_IT = 0.93
"""Errors above this fraction of the present ones are no improvement."""


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
        noises = {"sigma_px": model.sigma_px, "bar_scatter_m": model.scatter_m}
        return FileForecast(
            predictive.forecast(method, threshold_px).to_json(),
            {
                **{
                    name: {"value": float(each.value), "source": each.source}
                    for name, each in noises.items()
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
            method: self.of_file(method, validation.get(method, {}).get("threshold_px"))
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


def improvements(model: RefinedResult, seed: int = 0) -> dict[str, float]:
    """The mean length errors of the refined set, a fraction, as they are (key ""), and with each
    improvement, on the same simulated bars.
    """
    names = model.unknowns.names
    of_lens = np.array([name.split()[0] in ("primary", "secondary") for name in names])
    of_baseline = np.array([name == "baseline" for name in names])
    cases = {
        "": model,
        "exactly known lenses": _knowing(model, of_lens),
        "an exactly known baseline": _knowing(model, of_baseline),
        f"{MORE_FRAMES} times as many frames": replace(
            model, information=MORE_FRAMES * model.information
        ),
        "everything known exactly": _knowing(model, np.ones(len(names), dtype=np.bool_)),
    }
    files: Mapping[Method, Rig] = {"refined": Rig(model.primary, model.secondary, model.pose)}
    found = {}
    for name, knowledge in cases.items():
        judged = predict(model, files, seed, DRAWS, BARS, knowledge=knowledge)
        found[name] = float(np.nanmean(judged.errors_3d))
    return found


def _knowing(model: RefinedResult, known: BoolArray) -> RefinedResult:
    """The model with some of its free parameters known."""
    M, precision = model.unknowns.M, model.unknowns.precision
    whole = np.diag(M.T @ model.information @ M + precision)
    narrow = precision + np.diag(np.where(known, KNOWN * whole, 0.0))
    return replace(model, unknowns=replace(model.unknowns, precision=narrow))


def advice_on_improvements(model: RefinedResult, seed: int = 0) -> str:
    """Which improvement would lower the length error of the refined set most, for the user."""
    found = improvements(model, seed)
    now, limit = found.pop(""), found.pop("everything known exactly")
    name = min(found, key=lambda name: found[name])
    noise = f"image noise alone causes a length error of {rounded(100 * limit)} %"
    if found[name] > WORTH_IT * now:
        return f"Better lenses, a better baseline or more frames would change little: {noise}."
    return (
        f"What would help most: {name}. The refined set would measure with an error of "
        f"{rounded(100 * found[name])} % instead of {rounded(100 * now)} %; {noise}."
    )
