"""What one parameter file does, by the forecast and on held-out frames, and whether they agree."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from scipy.stats import binom

from stereocal.calibration.methods import Method
from stereocal.evaluation.summary import Estimate
from stereocal.fit.errors.length_in_metres import BarKnown, p95_of_factor
from stereocal.fit.least_squares.small_steps import FACTOR
from stereocal.fit.results import Calibration
from stereocal.rig.lengths_in_words import word_of
from stereocal.rig.parameters import ForecastEntries
from stereocal.system.numbers import digits
from stereocal.verdict.forecast import Forecast
from stereocal.verdict.forecast_draws import ForecastFigures

CHANCE = 0.975
"""Held-out figures below this quantile of what the upper end of a forecast allows are chance."""
OF_QUANTILE = 1.96 * 0.95
"""Standard errors of that quantile, times the relative one of the 95 % quantile of one normal
error: of n it is 0.95 / sqrt(n)."""
SMALLEST_EXCESS = 1.3
"""Held-out over the upper end of a forecast: what splits that fit fewer frames explain by
themselves."""
Validated = Mapping[str, Any]
"""The entry of a parameter file on its validation."""


@dataclass(frozen=True)
class Figure:
    """One figure of a file: forecast for frames to come, and on held-out frames."""

    forecast: Estimate | None
    held_out: float | None
    """None without a validation, or if no value could be computed."""
    allowed: float = math.inf
    """The largest held-out value that the forecast and chance explain."""

    @property
    def agrees(self) -> bool:
        """Whether the held-out value does not contradict the forecast."""
        return self.held_out is None or not self.held_out > self.allowed

    def best(self, forecast_holds: bool) -> Estimate | float | None:
        """The forecast if it holds, else the worse of both; None if unknown."""
        ahead, held_out = self.forecast, self.held_out
        if ahead is None or held_out is None:
            return held_out if ahead is None else ahead
        return ahead if forecast_holds or ahead.value > held_out else held_out


@dataclass(frozen=True)
class FileFigures:
    """What one parameter file does."""

    method: Method
    threshold_px: float | None
    """Matching threshold in the file: of the validation, else of the forecast."""
    is_threshold_held_out: bool
    wrong_let_in: Figure
    """Share of the wrong pairs below `threshold_px`."""
    wrong_pairs: int
    """Number of wrong pairs of the validation."""
    length_p95: Figure
    """Relative length error of 95 % of the bars."""
    metric_p95: Figure
    """The same of lengths in metres, with the error of the bar."""

    @property
    def contradicted(self) -> dict[str, float]:
        """The held-out values that contradict the forecast, by the name of the figure."""
        values = {}
        if not self.wrong_let_in.agrees and self.wrong_let_in.held_out is not None:
            values["wrong_let_in_at_threshold"] = self.wrong_let_in.held_out
        if not self.length_p95.agrees and self.length_p95.held_out is not None:
            values["p95_error_3d"] = self.length_p95.held_out
            values["p95_metric_error_3d"] = self.metric_p95.held_out or self.length_p95.held_out
        return values

    @property
    def below(self) -> str:
        """The threshold in a sentence, and what it is of."""
        if self.threshold_px is None:
            return ""
        source = "held-out frames" if self.is_threshold_held_out else "forecast"
        return f" below {digits(self.threshold_px, 2)} px ({source})"


def figures_of(
    method: Method,
    calibration: Calibration,
    forecast: Forecast | None,
    validation: Mapping[Any, Validated],
) -> FileFigures:
    """What the file of a method does, by forecast and validation."""
    validated: Validated = validation.get(method, {})
    held_out_limit = _finite(validated.get("threshold_px"))
    pairs = int(validated.get("wrong_pairs", 0))
    limit, usual, at_limit = held_out_limit, None, None
    if forecast is not None and method in forecast.files:
        usual = forecast.draws.figures[method]
        limit = _finite(usual.threshold_px.value) if limit is None else limit
        at_limit = forecast.draws.figures_of(method, held_out_limit)
    points = calibration.screening.dataset.correspondences
    n, bars = len(points), max(len(points.bars), 1)
    # The pairs of i with j and of j with i are let in together, and runs repeat them.
    distinct = max(min(n * (n - 1), pairs) // 2, 1)

    def share(high: float) -> float:
        return float(binom.ppf(CHANCE, distinct, min(high, 1.0))) / distinct

    def quantile(high: float) -> float:
        return high * (1.0 + OF_QUANTILE / math.sqrt(bars))

    def figure(name: str, figures: ForecastFigures | None) -> Figure:
        ahead, held_out = getattr(figures, name, None), _finite(validated.get(name))
        if ahead is None or not math.isfinite(ahead.value):
            return Figure(None, held_out)
        by_chance = quantile if name.endswith("_3d") else share
        allowed = max(by_chance(ahead.high), SMALLEST_EXCESS * ahead.high)
        return Figure(ahead, held_out, allowed)

    lengths = figure("p95_error_3d", usual)
    bar = bar_known(calibration, forecast)
    held_out = lengths.held_out
    metric = None if held_out is None else _finite(math.hypot(held_out, bar.p95))
    return FileFigures(
        method,
        limit,
        held_out_limit is not None,
        figure("wrong_let_in_at_threshold", at_limit),
        pairs,
        lengths,
        Figure(figure("p95_metric_error_3d", usual).forecast, metric),
    )


def bar_known(calibration: Calibration, forecast: Forecast | None) -> BarKnown:
    """How well the bar is known, by the forecast if there is one, else by the refined set."""
    dataset, refined = calibration.dataset, calibration.refined
    stated, p95 = dataset.target_distance_sigma_m, None
    if refined is not None:
        sigma_m = refined.settings.distance_sigma_m
        stated = stated if sigma_m is None else sigma_m
        p95 = p95_of_factor(refined.bar_factor, refined.covariance[FACTOR, FACTOR])
    if forecast is not None:
        p95 = forecast.draws.bar_p95
    return BarKnown.of(word_of(dataset), dataset.target_distance_m, stated, p95)


def stated_in(entries: ForecastEntries, name: str) -> Estimate:
    """A figure as it stands in a file."""
    ends = {
        end: math.nan if value is None else value for end, value in entries.figures[name].items()
    }
    return Estimate(**ends)


def _finite(value: float | None) -> float | None:
    """The value; None if it could not be computed."""
    return float(value) if value is not None and math.isfinite(value) else None
