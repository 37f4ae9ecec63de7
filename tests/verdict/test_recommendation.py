"""The recommendation: its files, figures and sentences, on forecasts whose answer is known."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stereocal.calibration.methods import Method
from stereocal.evaluation.counting import BINS, CORRECT, WRONG
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.fit.results import Calibration
from stereocal.library.calibrations import calibrate
from stereocal.rig.parameters import RigParameters
from stereocal.system.numbers import rounded
from stereocal.verdict.forecast import Forecast, forecast_files, verdict
from stereocal.verdict.forecast_draws import ForecastDraws
from stereocal.verdict.in_words import percent
from stereocal.verdict.model_check import HeldOutRatio, ModelCheck
from stereocal.verdict.recommendation import NO_FORECAST, NO_REFINED, Recommendation, recommend
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.rigs import known_rig as rig
from tests.rigs.refined_rigs import Misjudged, random_scene, stated


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    data = rig.dataset(20, 0.2)
    return replace(calibrate(data), refined=refine(data))


@pytest.fixture(scope="module")
def forecast(calibration: Calibration) -> Forecast:
    return forecast_files(calibration)


def answer_of(calibration: Calibration, forecast: Forecast, figures: Any = None) -> PairAnswer:
    run = PairRun.of(calibration)
    vars(run)["forecast_or_reason"] = forecast
    return PairAnswer(run, figures=figures)


def told(
    calibration: Calibration,
    forecast: Forecast,
    draws: ForecastDraws,
    validation: Any = None,
    check: ModelCheck | None = None,
) -> Recommendation:
    return recommend(calibration, replace(forecast, draws=draws, check=check), validation)


def entry(threshold: float, **more: Any) -> dict[str, Any]:
    """The figures of a validation, as in a file."""
    return {
        "threshold_px": threshold,
        "wrong_let_in_at_threshold": 0.004,
        "wrong_pairs": 9000,
        "median_error_3d": 0.002,
        "p95_error_3d": 0.006,
        **more,
    }


WITHIN: dict[Method, dict[str, Any]] = {
    method: {"threshold_px": 0.4, "wrong_let_in_at_threshold": 0.0, "wrong_pairs": 9000}
    | {"median_error_3d": 0.001, "p95_error_3d": 0.002}
    for method in ("2d", "3d", "refined")
}
VALIDATION: dict[Method, dict[str, Any]] = {
    "2d": entry(0.4),
    "3d": entry(9.0),
    "refined": entry(0.3),
}


def test_one_set(calibration: Calibration, forecast: Forecast) -> None:
    found = told(calibration, forecast, forecast_with(0.8, 0.9, 0.02))
    assert (found.match.method, found.measure.method) == ("refined", "refined")
    first, ahead, sure = found.sentences
    assert "Use the refined set for both: match below " in first
    assert ahead.startswith("Forecast for similar bars: ")
    assert "of wrong pairs are accepted, and 95 % of lengths are within" in ahead
    assert "One set does both jobs here (more than 99 % sure)." in sure
    assert "Or the paper's two: match with the 2D set below" in sure
    assert found.forecast_holds and not found.caution


def test_two_sets(calibration: Calibration, forecast: Forecast) -> None:
    found = told(calibration, forecast, forecast_with(2.0, 1.5, 0.02))
    assert (found.match.method, found.measure.method) == ("2d", "3d")
    assert found.verdict is not None and found.verdict.kind == "two"
    assert "Two sets are worth it here (more than 99 % sure)." in found.text
    assert f"{found.verdict.measuring.value:.2f} times the length error of the 3D set" in found.text


def test_not_decided(calibration: Calibration, forecast: Forecast) -> None:
    found = told(calibration, forecast, forecast_with(0.9, 0.9, 0.15))
    assert found.verdict is not None and found.verdict.kind == "level"
    assert "One set or two is not decided" in found.text
    assert "For now, use the refined set for both" in found.text
    assert f"About {found.verdict.frames_to_add} more frames would decide it." in found.text


def test_figures_and_threshold_are_those_of_the_file(
    calibration: Calibration, forecast: Forecast
) -> None:
    found = recommend(calibration, forecast, VALIDATION)
    sets = answer_of(calibration, forecast, VALIDATION).sets
    file = sets[found.match.method]
    assert found.match.threshold_px == file.matching_threshold_px
    assert file.predicted is not None
    ahead = found.match.wrong_let_in.forecast
    assert ahead is not None
    assert ahead.value == file.predicted["wrong_let_in_at_threshold"]["value"]
    assert found.match.wrong_let_in.held_out == 0.004
    assert found.measure.length_p95.held_out == 0.006
    # Two figures of two things: each says of what.
    assert any(s.startswith("Held out here: 0.40 % of wrong") for s in found.sentences)
    of = f"Forecast for similar bars: {percent(ahead.value)} %"
    assert any(s.startswith(of) for s in found.sentences)
    without = recommend(calibration, forecast)
    figures = forecast.draws.figures[without.match.method]
    assert without.match.threshold_px == figures.threshold_px.value
    assert without.match.wrong_let_in.held_out is None


def test_a_doubted_model_lets_held_out_frames_speak(
    calibration: Calibration, forecast: Forecast
) -> None:
    doubted = held_out(2.0, 1.0)
    found = told(calibration, forecast, forecast_with(0.8, 0.9, 0.02), VALIDATION, doubted)
    assert not found.forecast_holds
    of_length, held_out_here, ahead = found.sentences[0], *found.sentences[1:3]
    assert "is right to 6 mm, 95 % of the time" in of_length
    assert "95 % of lengths are within 0.60 %" in held_out_here
    assert ahead.startswith("Forecast for similar bars, which does not hold: ")
    assert "The model does not explain these images" in found.text


def test_without_a_forecast_the_papers_two(calibration: Calibration) -> None:
    found = recommend(calibration, None, VALIDATION)
    assert (found.match.method, found.measure.method) == ("2d", "3d")
    # 0.6 % of scatter, and a bar that is taken as known to 0.1 %, 95 % within 0.196 %.
    first, held_out_here, last = found.sentences
    assert "is right to 6.3 mm" in first and "Relative to the bar it is right to 6 mm" in first
    assert "Match with the 2D set below 0.40 px" in first
    assert "0.40 % of wrong pairs" in held_out_here and "within 0.60 %" in held_out_here
    assert last == NO_FORECAST
    because = recommend(calibration, None, VALIDATION, "The draws are too wide.")
    assert because.sentences[-1] == f"{NO_FORECAST} The draws are too wide."
    nothing = recommend(replace(calibration, refined=None), None)
    assert nothing.sentences == ("Match with the 2D set, and measure with the 3D set.", NO_REFINED)


def test_the_headline_has_the_error_of_the_bar() -> None:
    """Sharp images of a bar whose length is known to 0.1 %, or to 0.02 %: 1.96 of these, and the
    scatter, make the error of a length in metres; the scatter alone is the same."""
    data = rig.dataset(25, 0.005)
    bar = data.target_distance_m
    assumed, careful = (
        PairAnswer(PairRun(data.changed(target_distance_sigma_m=sigma))).recommendation
        for sigma in (None, 0.0002 * bar)
    )
    scatter = [found.measure.length_p95.forecast for found in (assumed, careful)]
    metric = [found.measure.metric_p95.forecast for found in (assumed, careful)]
    assert all(metric) and all(scatter)
    for own, of_bar, known in zip(metric, scatter, (0.001, 0.0002), strict=True):
        assert own is not None and of_bar is not None
        # 128 draws of the bar: a twelfth of it is their noise.
        assert own.value == pytest.approx(np.hypot(of_bar.value, 1.96 * known), rel=0.12)
        assert own.low <= own.value <= own.high
    assert "from the bar" in assumed.sentences[0]
    assert f"± {rounded(1000 * 0.001 * bar)} mm" in assumed.sentences[0]
    assert "how it was measured" in assumed.sentences[0]
    assert careful.sentences[0].count("how it was measured") == 0


def test_a_bar_that_the_images_contradict_is_not_said_to_be_known() -> None:
    """Stated 1 % too long, with a baseline that is known to a millimetre."""
    data = rig.dataset(25, 0.02)
    bar = 1.01 * data.target_distance_m
    run = PairRun(data.changed(target_distance_m=bar, baseline_sigma_m=0.001))
    found = PairAnswer(run).recommendation
    metric = found.measure.metric_p95.forecast
    assert metric is not None and metric.low <= metric.value <= metric.high
    assert "which the images contradict" in found.sentences[0] and "±" not in found.sentences[0]


def test_held_out_frames_that_contradict_the_forecast_are_the_headline(
    calibration: Calibration, forecast: Forecast
) -> None:
    """0.055 % of wrong pairs by the forecast, 2.1 % on held-out frames."""
    draws = forecast_with(0.8, 0.9, 0.02)
    agreeing = told(calibration, forecast, draws)
    ahead = agreeing.match.wrong_let_in.forecast
    assert ahead is not None and not agreeing.contradiction and agreeing.forecast_holds
    worse = {method: {**own, "wrong_let_in_at_threshold": 0.021} for method, own in WITHIN.items()}
    found = told(calibration, forecast, draws, worse)
    assert found.contradiction and not found.forecast_holds
    assert "2.1 %" in found.contradiction
    assert found.match.wrong_let_in.best(found.forecast_holds) == 0.021
    assert found.contradiction in found.to_json()["text"]
    half = {method: {**own, "wrong_let_in_at_threshold": 0.5} for method, own in worse.items()}
    answer = answer_of(calibration, replace(forecast, check=None), half)
    predicted = answer.sets[answer.recommendation.match.method].predicted
    assert predicted is not None and predicted["wrong_let_in_at_threshold"]["high"] == 0.5
    assert not told(calibration, forecast, draws, WITHIN).contradiction
    # One of 90 distinct pairs is chance, 8 of the 780 of 40 points are not.
    for pairs, by_chance in ((180, True), (9000, False)):
        about = {"wrong_let_in_at_threshold": 0.0105, "wrong_pairs": pairs}
        few = {method: {**own, **about} for method, own in worse.items()}
        assert bool(told(calibration, forecast, draws, few).contradiction) is not by_chance


def test_files_carry_it(calibration: Calibration, forecast: Forecast) -> None:
    found = answer_of(calibration, forecast)
    for rig_file in found.sets.values():
        read = RigParameters.loads(rig_file.dumps())
        assert read.recommendation == json.loads(json.dumps(found.recommendation.to_json()))


SETS: tuple[Method, ...] = ("2d", "3d", "refined")


def forecast_with(
    matching: float, measuring: float, spread: float, draws: int = 400
) -> ForecastDraws:
    """Draws in which the refined set is worse by these factors than each job's own set."""
    rng = np.random.default_rng(1)
    noise = np.exp(spread * rng.normal(size=(2, draws, 1)))
    counts = np.zeros((draws, 2, 3, 2, 2, BINS + 2), dtype=np.uint16)
    counts[..., WRONG, 700], counts[..., CORRECT, 500] = 9, 10
    px = np.ones((draws, 2, 3)) * np.array([0.1, 3.0, 0.1])
    px[:, :, 2] *= matching * noise[0]
    error = np.ones((draws, 2, 3)) * np.array([0.01, 0.002, 0.002])
    error[:, :, 2] *= measuring * noise[1]
    lengths = 1.0 + np.repeat(error[..., None], 20, axis=3)
    depths, radii = rng.uniform(4, 10, (draws, 2, 20)), rng.uniform(0, 1, (draws, 2, 20))
    bar = np.ones(draws)
    return ForecastDraws(SETS, counts, px, lengths, depths, radii, 25, bar)


def held_out(px: float, length: float) -> ModelCheck:
    """A check with these errors over the forecast, known to a tenth."""
    ratios = [
        HeldOutRatio("", what, ratio, float(np.log(ratio)) / 0.1)
        for what, ratio in (("in the images", px), ("in length", length))
    ]
    return ModelCheck(ratios[0], ratios[1], ())


@pytest.mark.parametrize(
    ("matching", "measuring", "kind", "files"),
    [
        (0.8, 0.9, "one", ("refined", "refined")),
        (1.0, 1.0, "one", ("refined", "refined")),
        (2.0, 0.9, "two", ("2d", "refined")),
        (0.9, 1.5, "two", ("refined", "3d")),
        (1.6, 1.5, "two", ("2d", "3d")),
    ],
)
def test_clear_cases(matching: float, measuring: float, kind: str, files: tuple[str, str]) -> None:
    answer = verdict(forecast_with(matching, measuring, spread=0.02), 25)
    assert answer.kind == kind
    assert (answer.match_with, answer.measure_with) == files
    assert answer.frames_to_add is None
    assert answer.matching.low < matching < answer.matching.high
    assert answer.measuring.low < measuring < answer.measuring.high
    assert "the 3D set to 0.20 %" in answer.figures
    assert answer.check is None


def test_wide_intervals_ask_for_frames_and_still_name_files() -> None:
    answer = verdict(forecast_with(0.9, 0.9, spread=0.15), 25)
    assert answer.kind == "level"
    assert answer.frames_to_add is not None
    assert (answer.match_with, answer.measure_with) == ("refined", "refined")
    wider = verdict(forecast_with(0.9, 0.9, spread=0.2), 25)
    assert wider.frames_to_add is not None
    assert wider.frames_to_add > answer.frames_to_add > 0
    hopeless = verdict(forecast_with(1.1, 0.9, spread=0.5), 25)
    assert hopeless.frames_to_add is None


def test_a_model_that_does_not_hold_decides_for_no_single_set() -> None:
    one = forecast_with(0.8, 0.9, 0.02)
    sound = verdict(one, 25, held_out(1.05, 1.0))
    assert sound.kind == "one"
    doubted = verdict(one, 25, held_out(2.0, 1.0))
    assert doubted.kind == "level"
    # Two sets are needed the more so.
    assert verdict(forecast_with(2.0, 0.9, 0.02), 25, held_out(2.0, 1.0)).kind == "two"


def test_from_data_to_verdict() -> None:
    """Lenses off: one set does both, for it alone can move the lenses."""
    rng = np.random.default_rng(21)
    data = stated(random_scene(rng, 60), rng, Misjudged(noise_px=0.05))
    forecast = forecast_files(calibrate(data, refined=RefineSettings()))
    answer = forecast.verdict
    assert answer.kind == "one"
    assert answer.matching.value < 1
    assert answer.check is not None
    assert answer.check.holds
