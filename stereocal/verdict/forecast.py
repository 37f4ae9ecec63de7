"""The forecast of all files of a calibration, whether one set is enough, and what would improve it.

Two sets are needed where, on fresh bars, the refined set is more than 10 % worse than the 2D set in
mean reprojection error, or than the 3D set in mean length error. The forecast judges all three on
the same simulated images (`forecast_draws`), so that the verdict is its share of draws. It is right
as far as the model is: errors on held-out frames are compared with it (`model_check`), and where
they are larger, the verdict says so and does not decide for one set. For two it still does:
what the model lacks makes one set worse, not better (right in all 6 simulated rigs looked at).

For an improvement, the forecast of the refined set is repeated with a distribution of the truth
that is as narrow as the improvement would make it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from stereocal.calibration.methods import FILE_METHODS, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.fit.least_squares.small_steps import (
    FACTOR,
    baseline_direction,
    rig_at,
    step_between,
    with_own_windows,
)
from stereocal.fit.parameter_file import covariance_entry
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.results import Calibration
from stereocal.rig.camera import LENS_UNKNOWNS
from stereocal.rig.parameters import ForecastEntries
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from stereocal.system.numbers import digits, rounded
from stereocal.verdict.forecast_draws import DRAWS, ForecastDraws, draw_forecast
from stereocal.verdict.intervals import TAILS
from stereocal.verdict.model_check import ModelCheck, check_model

TOLERANCE = 0.10
"""One set is sufficient if its errors exceed those of the specialised sets by at most this
fraction."""
SURE = 0.975
"""Share of the draws that decides."""
LEAST_KNOWN = 0.5
"""Share of the draws in which the bars are seen; with fewer, they tell nothing."""
MAXIMUM_TO_ADD = 10
"""Largest number of frames to add that is reported, as a multiple of the present number."""
Kind = Literal["one", "two", "level"]
FEW_DRAWS, FEW_BARS = 32, 100
"""Draws and bars of each half, for improvements."""
LENS_PARTS = ("focal", *LENS_UNKNOWNS)
KNOWN = 1e6
"""Factor of the information about a parameter that is known exactly."""
MORE_FRAMES = 4
WORTH_IT = 0.93
"""Errors above this fraction of the present ones are no improvement."""


@dataclass(frozen=True)
class Verdict:
    """The verdict and the numbers behind it; its sentences are those of the `recommendation`."""

    kind: Kind
    figures: str
    """The mean errors of the sets that are forecast, for the user."""
    matching: Estimate
    """Refined over 2D set, mean reprojection error."""
    measuring: Estimate
    """Refined over 3D set, mean length error."""
    chance_of_one: float
    """Share of the draws in which one set does both jobs."""
    match_with: Method
    measure_with: Method
    frames_to_add: int | None
    """For `level`: approximate number of further frames that would decide; None if more than
    `MAXIMUM_TO_ADD` times the present number, or if nothing is to be decided."""
    check: ModelCheck | None
    """None if there are too few frames for one."""

    @property
    def holds(self) -> bool:
        """Whether held-out frames do not contradict the forecast."""
        return self.check is None or self.check.holds


def verdict(draws: ForecastDraws, frames: int, check: ModelCheck | None = None) -> Verdict:
    """The verdict of a forecast of all files, for a calibration of so many frames."""
    in_images, in_length = _ratios(draws)
    limit = 1.0 + TOLERANCE
    matching, measuring = (
        Estimate(float(value), float(low), float(high))
        for low, value, high in (
            np.nanpercentile(ratio, (TAILS[0], 50, TAILS[1])) for ratio in (in_images, in_length)
        )
    )
    chance = float(np.mean((in_images <= limit) & (in_length <= limit)))
    surely_one = chance >= SURE and (check is None or check.holds)
    kind: Kind = "two" if chance <= 1.0 - SURE else "one" if surely_one else "level"
    match_with, measure_with = files_to_use(draws)
    add = _frames_to_add((matching, measuring), frames) if kind == "level" else None
    figures = _figures(draws, matching, measuring)
    return Verdict(kind, figures, matching, measuring, chance, match_with, measure_with, add, check)


def files_to_use(draws: ForecastDraws) -> tuple[Method, Method]:
    """The file to match with, and the one to measure with."""
    in_images, in_length = (
        np.nanpercentile(ratio, 50) > 1.0 + TOLERANCE for ratio in _ratios(draws)
    )
    return "2d" if in_images else "refined", "3d" if in_length else "refined"


def _ratios(draws: ForecastDraws) -> tuple[FloatArray, FloatArray]:
    """(draws,) each: errors of the refined set over those of the 2D set in the images, and of the
    3D set in length."""
    in_images = draws.ratio(draws.correct_px, "refined", "2d")
    return in_images, draws.ratio(draws.mean_errors_3d, "refined", "3d")


def sure(chance: float) -> str:
    """A probability, for the user."""
    return "more than 99 %" if chance > 0.99 else f"{100 * chance:.0f} %"


def _figures(draws: ForecastDraws, matching: Estimate, measuring: Estimate) -> str:
    of = draws.figures
    px = {name: f"{digits(of[name].mean_reprojection_px.value, 2)} px" for name in FILE_METHODS}
    length = {name: f"{digits(100 * of[name].mean_error_3d.value, 2)} %" for name in FILE_METHODS}
    times = [
        f"{ratio.value:.2f} times, {ratio.low:.2f} to {ratio.high:.2f}"
        for ratio in (matching, measuring)
    ]
    return (
        f"Forecast, mean errors: the refined set matches to {px['refined']}, the 2D set to "
        f"{px['2d']} ({times[0]}); it measures to {length['refined']}, the 3D set to "
        f"{length['3d']} ({times[1]})."
    )


def _frames_to_add(ratios: Sequence[Estimate], frames: int) -> int | None:
    """Number of additional frames after which no interval should contain the limit, if their widths
    fall with the square root of the number of frames; None if many.
    """
    limit = np.log1p(TOLERANCE)
    needed = 1.0
    for ratio in ratios:
        if np.log(ratio.low) <= limit < np.log(ratio.high):
            side = ratio.high if np.log(ratio.value) <= limit else ratio.low
            half = abs(np.log(side / ratio.value))
            gap = abs(np.log(ratio.value) - limit)
            needed = max(needed, float(np.square(half / max(gap, 1e-9))))
    if needed > MAXIMUM_TO_ADD:
        return None
    return max(5 * int(np.ceil((needed - 1.0) * frames / 5)), 5)


@dataclass(frozen=True, eq=False)
class Forecast:
    """The forecast of all files of a calibration."""

    files: Mapping[Method, Rig]
    refined: RefinedResult
    model: RefinedResult
    """The refined fit without the priors of the accused inputs."""
    draws: ForecastDraws
    check: ModelCheck | None
    """Whether held-out frames agree with the forecast; None with too few frames."""

    @cached_property
    def verdict(self) -> Verdict:
        """Whether two sets are needed, and which files to use."""
        frames = len(self.refined.dataset.correspondences.frames)
        return verdict(self.draws, frames, self.check)

    def of_file(self, method: Method, threshold_px: float | None = None) -> ForecastEntries:
        """The entries of one parameter file.

        Args:
            threshold_px: at which the shares are given; None: the recommended one.
        """
        model = self.model
        noises = {"sigma_px": model.sigma_px, "bar_scatter_m": model.scatter_m}
        return ForecastEntries(
            self.draws.figures_of(method, threshold_px).to_json(),
            {
                **{
                    name: {"value": float(noise.value), "source": noise.source}
                    for name, noise in noises.items()
                },
                "covariance": covariance_entry(self.covariance(method), self.files[method]),
                "design_effect": model.design_effect,
            },
        )

    def of_files(
        self, validation: Mapping[Any, Mapping[str, Any]]
    ) -> dict[Method, ForecastEntries]:
        """The entries of all files, with the shares at the thresholds of a validation, if any."""
        return {
            method: self.of_file(method, validation.get(method, {}).get("threshold_px"))
            for method in self.files
        }

    def covariance(self, method: Method) -> FloatArray:
        """(33, 33): mean square deviation of a file from the truth, of the unknowns of `views`.

        That of the model about the truth, and the deviation of the file from the model.
        """
        model = self.model
        away = step_between(rig_at(self.files[method]), with_own_windows(model.at)[0])
        away[FACTOR] = 0.0
        return model.covariance_of_file + np.outer(away, away)


def forecast_files(calibration: Calibration, draws: int = DRAWS) -> Forecast:
    """Forecast the files of a calibration with its refined set.

    Args:
        draws: of the truth.

    Raises:
        StereocalError: there is no refined set, or it is too uncertain for one.
    """
    refined, comparison = calibration.refined, calibration.comparison
    if refined is None or comparison is None:
        raise StereocalError("A forecast needs the refined method.")
    stated = calibration.dataset
    files: dict[Method, Rig] = {
        method: Rig(stated.primary, stated.secondary, result.pose)
        for method, result in calibration.methods.items()
    }
    files["refined"] = Rig(refined.primary, refined.secondary, refined.pose)
    drawn = draw_forecast(comparison.model, files, draws=draws)
    if np.isfinite(drawn.correct_px).all(axis=(1, 2)).mean() < LEAST_KNOWN:
        raise StereocalError(
            "The lenses are so uncertain that most of those within their standard errors image "
            "nothing where the bars were."
        )
    check = check_model(refined, comparison.model, drawn)
    if check is not None and not check.holds:
        drawn = replace(drawn, excess=check.excess)
    return Forecast(files, refined, comparison.model, drawn, check)


def forecast_of_set(model: RefinedResult, draws: int = DRAWS) -> ForecastEntries | None:
    """The entries of a refined set alone, as behind windows, where it is the only one; None if its
    bars are too few for a forecast.

    Args:
        draws: of the truth.
    """
    files: dict[Method, Rig] = {"refined": model.rig}
    try:
        drawn = draw_forecast(model, files, draws=draws)
    except StereocalError:
        return None
    if np.isfinite(drawn.correct_px).all(axis=(1, 2)).mean() < LEAST_KNOWN:
        return None
    check = check_model(model, model, drawn)
    if check is not None and not check.holds:
        drawn = replace(drawn, excess=check.excess)
    return Forecast(files, model, model, drawn, check).of_file("refined")


def improvements(model: RefinedResult) -> dict[str, float]:
    """The mean length errors of the refined set, a fraction, as they are (key ""), and with each
    improvement, on the same simulated bars.
    """
    unknowns = model.unknowns
    every = np.eye(len(unknowns.names))
    of_lens = np.array([name.split()[-1] in LENS_PARTS for name in unknowns.names])
    cases = {
        "": model,
        "exactly known lenses": _knowing(model, every[of_lens]),
        "an exactly known baseline": _knowing(
            model, baseline_direction(model.at)[None] @ unknowns.M
        ),
        f"{MORE_FRAMES} times as many frames": replace(
            model, information=MORE_FRAMES * model.information
        ),
        "everything known exactly": _knowing(model, every),
    }
    files: Mapping[Method, Rig] = {"refined": Rig(model.primary, model.secondary, model.pose)}
    errors = {}
    for name, knowledge in cases.items():
        judged = draw_forecast(model, files, 0, FEW_DRAWS, FEW_BARS, knowledge=knowledge)
        errors[name] = float(np.nanmean(judged.errors_3d))
    return errors


def _knowing(model: RefinedResult, known: FloatArray) -> RefinedResult:
    """The model with some combinations (m, k) of its free parameters known."""
    unknowns = model.unknowns
    whole = unknowns.M.T @ model.information @ unknowns.M + unknowns.precision
    sizes = np.einsum("mk,kl,ml->m", known, whole, known) / np.square(known).sum(axis=1) ** 2
    narrow = unknowns.precision + KNOWN * known.T @ (sizes[:, None] * known)
    return replace(model, unknowns=replace(unknowns, precision=narrow))


def advice_on_improvements(model: RefinedResult) -> str:
    """Which improvement would lower the length error of the refined set most, for the user."""
    errors = improvements(model)
    now, limit = errors.pop(""), errors.pop("everything known exactly")
    name = min(errors, key=lambda name: errors[name])
    noise = f"image noise alone causes a mean length error of {rounded(100 * limit)} %"
    if errors[name] > WORTH_IT * now:
        return f"Better lenses, a better baseline or more frames would change little: {noise}."
    return (
        f"What would help most: {name}. The refined set would measure with a mean error of "
        f"{rounded(100 * errors[name])} % instead of {rounded(100 * now)} %; {noise}."
    )
