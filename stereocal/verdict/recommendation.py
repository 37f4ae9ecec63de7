"""The recommendation: which file to match with and which to measure with, and how good they are.

It is made here and nowhere else; pages, report, parameter files and command line show it. It joins
the forecast (`forecast_draws`), the same figures on the held-out frames of a validation, and the
verdict on one or two sets. Forecast and held-out figures differ, so each stands in a sentence of
its own that begins with what it is of.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from stereocal.calibration.methods import Method
from stereocal.evaluation.summary import Estimate
from stereocal.refined.results import Calibration
from stereocal.refined.stated_inputs import far_off
from stereocal.rig.dataset import Dataset
from stereocal.rig.lengths_in_words import word_of
from stereocal.system.answers import Answer
from stereocal.verdict.forecast import Forecast, Verdict, sure
from stereocal.verdict.forecast_draws import ForecastFigures
from stereocal.verdict.further_recording import sentence_on_runs
from stereocal.verdict.in_words import (
    digits,
    distance,
    interval,
    left_out_line,
    percent,
    why_held_out_not_trusted,
    why_not_trusted,
)

NAMES: Mapping[Method, str] = {
    "essential": "the essential matrix",
    "2d": "the 2D set",
    "3d": "the 3D set",
    "refined": "the refined set",
}
NO_FORECAST = "There is no forecast."
NO_REFINED = "There is no forecast, because there is no refined set."
Validated = Mapping[str, Any]
"""The entry of a parameter file on its validation."""


@dataclass(frozen=True)
class Figure:
    """One figure of a file: forecast for frames to come, and on held-out frames."""

    forecast: Estimate | None
    held_out: float | None
    """None without a validation, or if no value could be computed."""

    def best(self, forecast_holds: bool) -> Estimate | float | None:
        """The forecast if it holds, else the held-out value; None if unknown."""
        if self.forecast is not None and (forecast_holds or self.held_out is None):
            return self.forecast
        return self.held_out


@dataclass(frozen=True)
class FileFigures:
    """What one parameter file does."""

    method: Method
    threshold_px: float | None
    """Matching threshold in the file: of the validation, else of the forecast."""
    wrong_let_in: Figure
    """Share of the wrong pairs below `threshold_px`."""
    wrong_pairs: int
    """Number of wrong pairs of the validation."""
    length_p95: Figure
    """Relative length error of 95 % of the bars."""

    @property
    def below(self) -> str:
        """The threshold in a sentence."""
        return "" if self.threshold_px is None else f" below {digits(self.threshold_px, 2)} px"


@dataclass(frozen=True, repr=False)
class Recommendation(Answer):
    """Which files to use for what, how good they are, and how sure that is."""

    match: FileFigures
    measure: FileFigures
    verdict: Verdict | None
    """None without a forecast."""
    sentences: tuple[str, ...]
    """For the user: what to use, how sure that is, and what was left out."""
    caution: str
    """Why the result is not to be relied on; else empty."""

    @property
    def use(self) -> Mapping[Literal["matching", "measuring"], Method]:
        """The set for each purpose."""
        return {"matching": self.match.method, "measuring": self.measure.method}

    @property
    def forecast_holds(self) -> bool:
        """Whether there is a forecast that held-out frames do not contradict."""
        return self.verdict is not None and self.verdict.holds

    @property
    def answer(self) -> list[str]:
        warning = [f"Do not rely on this result: {self.caution}"] if self.caution else []
        return [*warning, *self.sentences[:1], " ".join(self.sentences[1:])]

    @property
    def text(self) -> str:
        """All sentences."""
        return " ".join(filter(None, self.answer))

    def to_json(self) -> dict[str, Any]:
        """The entry of a parameter file."""
        return {
            "match_with": self.match.method,
            "matching_threshold_px": self.match.threshold_px,
            "measure_with": self.measure.method,
            "one_or_two_sets": None if self.verdict is None else self.verdict.kind,
            "text": self.text,
        }


def recommend(
    calibration: Calibration,
    forecast: Forecast | None,
    validation: Mapping[Any, Validated] | None = None,
    no_forecast: str = "",
) -> Recommendation:
    """The recommendation for a calibration.

    Args:
        forecast: the forecast of its files; None if there is none: then the paper's two files are
            recommended, on held-out frames alone.
        validation: by method, as in the files.
        no_forecast: why there is none.
    """
    validation = validation or {}
    found = None if forecast is None else forecast.verdict
    match = figures_of(found.match_with if found else "2d", forecast, validation)
    measure = figures_of(found.measure_with if found else "3d", forecast, validation)
    certainty = (
        NO_REFINED if calibration.refined is None else f"{NO_FORECAST} {no_forecast}".rstrip()
    )
    in_runs = ""
    if forecast is not None and found is not None:
        certainty = _how_sure(found, forecast, validation)
        if forecast.draws.further:
            in_runs = sentence_on_runs(forecast.refined)
    holds, left_out = found is not None and found.holds, left_out_line(calibration.screening)
    lengths = _length_in_words(calibration.dataset, measure.length_p95, holds)
    use = " ".join(filter(None, (lengths, _use(match, measure))))
    ahead = frames_to_come(calibration, forecast)
    figures = _figures_in_words(match, measure, ahead, holds)
    errors = [own["p95_error_3d"] for own in validation.values()]
    if errors:
        caution = why_held_out_not_trusted([calibration.screening], errors)
    else:
        caution = why_not_trusted(calibration)
    caution = " ".join(filter(None, (caution, far_off(calibration.inputs))))
    sentences = tuple(filter(None, (use, *figures, certainty, left_out, in_runs)))
    return Recommendation(match, measure, found, sentences, caution)


def figures_of(
    method: Method, forecast: Forecast | None, validation: Mapping[Any, Validated]
) -> FileFigures:
    """What the file of a method does, by forecast and validation."""
    own: Validated = validation.get(method, {})
    limit = _finite(own.get("threshold_px"))
    usual = at_limit = None
    if forecast is not None and method in forecast.files:
        usual = forecast.draws.figures[method]
        limit = _finite(usual.threshold_px.value) if limit is None else limit
        at_limit = forecast.draws.figures_of(method, _finite(own.get("threshold_px")))

    def figure(name: str, figures: ForecastFigures | None) -> Figure:
        found = None if figures is None else getattr(figures, name)
        known = found is not None and math.isfinite(found.value)
        return Figure(found if known else None, _finite(own.get(name)))

    return FileFigures(
        method,
        limit,
        figure("wrong_let_in_at_threshold", at_limit),
        int(own.get("wrong_pairs", 0)),
        figure("p95_error_3d", usual),
    )


def _finite(value: float | None) -> float | None:
    """The value; None if it could not be computed."""
    return float(value) if value is not None and math.isfinite(value) else None


def frames_to_come(calibration: Calibration, forecast: Forecast | None) -> str:
    """What the forecast is of."""
    in_runs = forecast is not None and forecast.draws.further
    return "a further recording" if in_runs else f"similar {word_of(calibration.dataset)}s"


def _length_in_words(dataset: Dataset, within: Figure, holds: bool) -> str:
    """The error of a length in its own unit; empty if unknown.

    Of the power of ten next to the known distances, because the share that image noise has in a
    relative error depends on the length.
    """
    best = within.best(holds)
    share = best.value if isinstance(best, Estimate) else best
    if share is None:
        return ""
    length = 10.0 ** round(math.log10(float(np.median(dataset.bar_distances_m))))
    right_to = distance(share * length)
    return f"A length of {distance(length)} is right to {right_to}, 95 % of the time."


def _use(match: FileFigures, measure: FileFigures) -> str:
    """What to use."""
    if match.method == measure.method:
        return f"Use {NAMES[match.method]} for both: match{match.below}, and measure."
    matching = f"Match with {NAMES[match.method]}{match.below}"
    return f"{matching}, and measure with {NAMES[measure.method]}."


def _figures_in_words(
    match: FileFigures, measure: FileFigures, ahead: str, holds: bool
) -> tuple[str, ...]:
    """The figures, a sentence for each thing that they are of; the one to rely on comes first."""
    wrong, within = match.wrong_let_in, measure.length_p95
    doubted = "" if holds else ", which does not hold"
    forecast = _sentence(f"Forecast for {ahead}{doubted}", wrong.forecast, within.forecast)
    held_out = _sentence("Held out here", wrong.held_out, within.held_out)
    return (forecast, held_out) if holds else (held_out, forecast)


def _sentence(of: str, wrong: Estimate | float | None, within: Estimate | float | None) -> str:
    parts = []
    if wrong is not None:
        parts.append(f"{in_percent(wrong)} of wrong pairs are accepted")
    if within is not None:
        parts.append(f"95 % of lengths are within {in_percent(within)}")
    return f"{of}: {', and '.join(parts)}." if parts else ""


def in_percent(figure: Estimate | float) -> str:
    """A share or a relative error in percent, with its interval if it has one."""
    if not isinstance(figure, Estimate):
        return f"{percent(figure)} %"
    known = math.isfinite(figure.low) and math.isfinite(figure.high)
    return f"{percent(figure.value)} %" + (f" ({interval(figure)})" if known else "")


def _how_sure(found: Verdict, forecast: Forecast, validation: Mapping[Any, Validated]) -> str:
    """How sure the verdict is, and what the alternative does."""
    two = f"Two sets are worth it here ({sure(1 - found.chance_of_one)} sure). "
    if found.check is not None and not found.check.holds:
        return (two if found.kind == "two" else "") + found.check.text
    if found.kind == "two":
        return (
            f"{two}The refined set alone has {found.matching.value:.2f} times the reprojection "
            f"error of the 2D set and {found.measuring.value:.2f} times the length error of the "
            "3D set."
        )
    if found.kind == "one":
        lengths = figures_of("3d", forecast, validation).length_p95.forecast
        within = lengths and f", 95 % of lengths within {in_percent(lengths)} by the forecast"
        below = figures_of("2d", forecast, validation).below
        return (
            f"One set does both jobs here ({sure(found.chance_of_one)} sure). Or the paper's two: "
            f"match with the 2D set{below}, measure with the 3D set{within or ''}."
        )
    more = (
        f"About {found.frames_to_add} more frames would decide it."
        if found.frames_to_add
        else "More frames would hardly decide it, and little depends on it."
    )
    return (
        "One set or two is not decided: one does both jobs with a probability of "
        f"{100 * found.chance_of_one:.0f} %. {more}"
    )
