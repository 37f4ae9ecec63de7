"""The recommendation: which file to match with and which to measure with, and how good they are.

It is made here and nowhere else; pages, report, parameter files and command line show it. It joins
the forecast (`forecast_draws`), the same figures on the held-out frames of a validation, and the
verdict on one or two sets. Forecast and held-out figures differ, so each stands in a sentence of
its own that begins with what it is of.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from stereocal.calibration.methods import PAPER_SETS, Method
from stereocal.evaluation.summary import Estimate
from stereocal.fit.errors.length_in_metres import length_in_words
from stereocal.fit.errors.stated_inputs import far_off
from stereocal.fit.results import Calibration
from stereocal.rig.lengths_in_words import word_of
from stereocal.system.answers import Answer
from stereocal.verdict.file_figures import FileFigures, Validated, bar_known, figures_of
from stereocal.verdict.forecast import Forecast, Verdict, sure
from stereocal.verdict.further_recording import sentence_on_runs
from stereocal.verdict.in_words import (
    in_percent,
    left_out_line,
    why_held_out_not_trusted,
    why_not_trusted,
)
from stereocal.verdict.model_check import MINIMUM_FRAMES, exceeds_detection

NAMES: Mapping[Method, str] = {
    "essential": "the essential matrix",
    "2d": "the 2D set",
    "3d": "the 3D set",
    "refined": "the refined set",
}
NO_FORECAST = "There is no forecast."
NO_REFINED = "There is no forecast, because there is no refined set."
MANY_LEFT_OUT = 0.1
"""Share of the frames."""


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
    contradiction: str = ""
    """Where held-out frames contradict the forecast beyond chance, and why; else empty."""
    brief: tuple[str, ...] = ()
    """Of the sentences what to use, what speaks against the forecast, and what was left out."""

    @property
    def use(self) -> Mapping[Literal["matching", "measuring"], Method]:
        """The set for each purpose."""
        return {"matching": self.match.method, "measuring": self.measure.method}

    @property
    def forecast_holds(self) -> bool:
        """Whether there is a forecast that held-out frames do not contradict."""
        return self.verdict is not None and self.verdict.holds and not self.contradiction

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
    verdict = None if forecast is None else forecast.verdict
    match, measure = (
        figures_of(method, calibration, forecast, validation)
        for method in ((verdict.match_with, verdict.measure_with) if verdict else PAPER_SETS)
    )
    certainty = (
        NO_REFINED if calibration.refined is None else f"{NO_FORECAST} {no_forecast}".rstrip()
    )
    contradiction = in_runs = ""
    if forecast is not None and verdict is not None:
        if verdict.holds:  # else the check of the model has said it
            contradiction = _contradiction(calibration, forecast, match, measure)
        certainty = contradiction or _how_sure(verdict, calibration, forecast, validation)
        if forecast.draws.further:
            in_runs = sentence_on_runs(forecast.refined)
    holds, left_out = verdict is not None and verdict.holds, left_out_line(calibration.screening)
    holds = holds and not contradiction
    lengths = _length_in_words(calibration, forecast, measure, holds)
    use = " ".join(filter(None, (lengths, _use(match, measure, verdict))))
    ahead = frames_to_come(calibration, forecast)
    figures = _figures_in_words(match, measure, ahead, holds, word_of(calibration.dataset))
    errors = [entry["p95_error_3d"] for entry in validation.values()]
    if errors:
        caution = why_held_out_not_trusted([calibration.screening], errors)
    else:
        caution = why_not_trusted(calibration)
    caution = " ".join(filter(None, (caution, far_off(calibration.inputs))))
    sentences = tuple(filter(None, (use, *figures, certainty, left_out, in_runs)))
    against = contradiction if verdict is not None and verdict.holds else certainty
    brief = tuple(filter(None, (use, against, left_out)))
    return Recommendation(match, measure, verdict, sentences, caution, contradiction, brief)


def _contradiction(
    calibration: Calibration, forecast: Forecast, match: FileFigures, measure: FileFigures
) -> str:
    """Where held-out frames contradict the forecast beyond chance, and the likely reason."""
    contradicted = [
        f"{what.format(in_percent(figure.held_out))} instead of {in_percent(figure.forecast)}"
        for figure, what in (
            (match.wrong_let_in, "{} of wrong pairs were accepted"),
            (measure.length_p95, "95 % of lengths were within {}"),
        )
        if not figure.agrees and figure.held_out is not None and figure.forecast is not None
    ]
    if not contradicted:
        return ""
    screening, refined = calibration.screening, forecast.refined
    frames = len(screening.dataset.correspondences.frames)
    reasons = [
        f"few frames ({frames})" * (frames < MINIMUM_FRAMES),
        "many frames that contradict the others" * (screening.share > MANY_LEFT_OUT),
        "targets that are found less well than stated" * exceeds_detection(refined),
    ]
    likely = ", ".join(filter(None, reasons)) or "what the model lacks, as a wrong distortion"
    return (
        f"Held-out frames contradict the forecast: {'; '.join(contradicted)}. The worse figures "
        f"are shown. The likely reason: {likely}."
    )


def frames_to_come(calibration: Calibration, forecast: Forecast | None) -> str:
    """What the forecast is of."""
    in_runs = forecast is not None and forecast.draws.further
    return (
        "another recording in the same volume"
        if in_runs
        else f"similar {word_of(calibration.dataset)}s"
    )


def _length_in_words(
    calibration: Calibration, forecast: Forecast | None, measure: FileFigures, holds: bool
) -> str:
    """The error of a length in metres; empty if unknown."""
    total, scatter = (
        best.value if isinstance(best, Estimate) else best
        for best in (measure.metric_p95.best(holds), measure.length_p95.best(holds))
    )
    if total is None:
        return ""
    lengths = calibration.dataset.bar_distances_m
    return length_in_words(total, scatter, bar_known(calibration, forecast), lengths)


def _use(match: FileFigures, measure: FileFigures, verdict: Verdict | None) -> str:
    """What to use; for now, where it is not decided."""
    if match.method == measure.method:
        use = f"Use {NAMES[match.method]} for both: match{match.below}, and measure."
    else:
        matching = f"Match with {NAMES[match.method]}{match.below}"
        use = f"{matching}, and measure with {NAMES[measure.method]}."
    undecided = verdict is not None and verdict.kind == "level"
    return f"For now, {use[0].lower()}{use[1:]}" if undecided else use


def _figures_in_words(
    match: FileFigures, measure: FileFigures, ahead: str, holds: bool, word: str
) -> tuple[str, ...]:
    """The figures, a sentence for each thing that they are of; the one to rely on comes first."""
    wrong, within = match.wrong_let_in, measure.length_p95
    doubted = "" if holds else ", which does not hold"
    forecast = _sentence(f"Forecast for {ahead}{doubted}", wrong.forecast, within.forecast, word)
    held_out = _sentence("Held out here", wrong.held_out, within.held_out, word)
    return (forecast, held_out) if holds else (held_out, forecast)


def _sentence(
    of: str, wrong: Estimate | float | None, within: Estimate | float | None, word: str
) -> str:
    parts = []
    if wrong is not None:
        parts.append(f"{in_percent(wrong)} of wrong pairs are accepted")
    if within is not None:
        parts.append(f"95 % of lengths are within {in_percent(within)} relative to the {word}")
    return f"{of}: {', and '.join(parts)}." if parts else ""


def _how_sure(
    verdict: Verdict,
    calibration: Calibration,
    forecast: Forecast,
    validation: Mapping[Any, Validated],
) -> str:
    """How sure the verdict is, and what the alternative does."""
    two = f"Two sets are worth it here ({sure(1 - verdict.chance_of_one)} sure). "
    if verdict.check is not None and not verdict.check.holds:
        return (two if verdict.kind == "two" else "") + verdict.check.text
    if verdict.kind == "two":
        return (
            f"{two}The refined set alone has {verdict.matching.value:.2f} times the reprojection "
            f"error of the 2D set and {verdict.measuring.value:.2f} times the length error of the "
            "3D set."
        )
    if verdict.kind == "one":
        paper = [figures_of(method, calibration, forecast, validation) for method in PAPER_SETS]
        lengths = paper[1].length_p95.forecast
        within = lengths and f", 95 % of lengths within {in_percent(lengths)} by the forecast"
        return (
            f"One set does both jobs here ({sure(verdict.chance_of_one)} sure). Or the paper's "
            f"two: match with the 2D set{paper[0].below}, measure with the 3D set{within or ''}."
        )
    more = (
        f"About {verdict.frames_to_add} more frames would decide it."
        if verdict.frames_to_add
        else "More frames would hardly decide it, and little depends on it."
    )
    return (
        "One set or two is not decided: one does both jobs with a probability of "
        f"{100 * verdict.chance_of_one:.0f} %. {more}"
    )
