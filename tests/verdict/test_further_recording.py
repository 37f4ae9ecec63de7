"""Forecasts of recordings whose frames follow each other."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.evaluation.evaluate import EvaluationSettings, Splits, evaluate_runs
from stereocal.evaluation.summary import Estimate, summarise
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.screening.screen import screen
from stereocal.formats.dataset_files import read_dataset
from stereocal.library.calibrations import calibrate
from stereocal.rig.pair import Pair
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.further_recording import half_width, note_on_splits, widened
from tests.further import further
from tests.rigs.board_pairs import sound
from tests.rigs.population import figures_on
from tests.rigs.refined_rigs import Misjudged, waved

RECORDING = Path(__file__).parents[2] / "sample_data" / "recording"
FEW = 4
"""Draws of a forecast of which nothing drawn is looked at."""
FIGURES = ("mean_reprojection_px", "median_error_3d", "p95_error_3d", "fcp_reprojection")


def mean(errors: np.ndarray) -> np.ndarray:
    return np.asarray(errors.mean(axis=-1))


def test_shuffled_errors_have_little_excess_and_runs_have_theirs() -> None:
    rng = np.random.default_rng(0)
    alike = [half_width(np.abs(rng.standard_normal(400)), mean, 40, rng) for _ in range(20)]
    # A mean of 133 frames differs by 1.96 * 0.755 / sqrt(133) = 0.13 by chance.
    assert np.median(alike) == pytest.approx(0.13, rel=0.3)
    level = np.repeat(np.exp(0.3 * rng.standard_normal((20, 10))), 40, axis=1)
    apart = [half_width(each * np.abs(rng.standard_normal(400)), mean, 40, rng) for each in level]
    # Student's 2.26 times 0.3, times the root of 3/10 + 1/10: 0.43, and the 0.13 in quadrature.
    assert np.median(apart) == pytest.approx(0.45, rel=0.25)


def test_errors_that_stay_alike_for_long_leave_fewer_runs_and_wider_intervals() -> None:
    rng = np.random.default_rng(1)
    level = np.repeat(np.exp(0.3 * rng.standard_normal((20, 5))), 80, axis=1)
    errors = [each * np.abs(rng.standard_normal(400)) for each in level]
    short, long = (
        np.median([half_width(each, mean, length, rng) for each in errors]) for length in (1, 80)
    )
    # Student's 2.78 times 0.3, times the root of 3/5 + 1/5; measured: 0.32 and 0.56.
    assert 0.45 < long < 0.8
    assert short < 0.7 * long


def test_intervals_widen_on_both_sides_in_quadrature() -> None:
    found = widened(Estimate(1.0, np.exp(-0.3), np.exp(0.4)), 0.3)
    assert np.log(found.low) == pytest.approx(-np.hypot(0.3, 0.3))
    assert np.log(found.high) == pytest.approx(0.5)
    assert widened(Estimate(0.1, 0.0, 0.2), 0.3).low == 0.0


def test_the_first_quarter_of_a_recording_is_as_the_others_forecast() -> None:
    data = screen(read_dataset(RECORDING)).dataset
    frames = data.correspondences.frames
    rest = data.of_frames(frames[len(frames) // 4 :])
    forecast = forecast_files(calibrate(rest, refined=RefineSettings()))
    assert forecast.draws.further
    assert all(each.of_pairs >= each.in_images > 0 for each in forecast.draws.further.values())
    held, widths = [], []
    for method in ("2d", "3d", "refined"):
        true = figures_on(data.of_frames(frames[: len(frames) // 4]), forecast.files[method])
        for name in FIGURES:
            said = getattr(forecast.draws.figures[method], name)
            held.append(said.low <= true[name] <= said.high)
            widths.append((said.high - said.low) / said.value)
    # Measured: all 12, and 4 of 12 for independent frames; `benchmarks.forecasts quarters` has all.
    assert sum(held) >= 10
    assert np.median(widths) < 1.1


def test_the_fcp_of_a_waved_bar_differs_between_places_by_more_than_errors_do() -> None:
    """A bar that stays at five places: wrong pairs of one place are close together."""
    off = Misjudged(0.0, 0.0, 0.0, 0.0, 0.2)
    _, data = waved(np.random.default_rng([3, 27]), 200, 40, off)
    found = forecast_files(calibrate(data, refined=RefineSettings()), FEW).draws.further["2d"]
    assert found.of("fcp_reprojection") > 2 * found.of("mean_reprojection_px") > 0
    assert found.of("wrong_let_in_at_threshold") == found.of("fcp_reprojection")


def recorded(length: int, seed: int = 1) -> Pair:
    """200 frames of a bar through lenses with smooth errors, at another place every `length`."""
    off = Misjudged(0.0, 0.0, 0.0, 0.0, 0.1)
    return waved(np.random.default_rng([seed, 27]), 200, length, off, wave_px=1.0)[1]


def note(data: Pair, splits: Splits) -> str:
    settings = EvaluationSettings(runs=40, calibration_frames=160, splits=splits)
    runs = evaluate_runs(data, settings, 0, range(settings.runs))
    return note_on_splits(data, settings, summarise([runs]))


@pytest.mark.parametrize("splits", ["runs", *further("frames")])
def test_a_difference_is_stated_whichever_was_evaluated(splits: Splits) -> None:
    assert "Rely on the figures of whole runs" in note(recorded(20), splits)


def test_frames_taken_one_by_one_have_nothing_to_compare() -> None:
    assert note(recorded(1), "runs") == ""


def test_boards_whose_corners_share_errors_have_wider_intervals() -> None:
    """Boards of one recording out of focus by turns: each is a run, taken one by one."""
    pair, rng = sound(0, frames=12, baseline=True), np.random.default_rng(2)
    levels = np.where(np.arange(12) % 2, 0.1, 0.8)[:, None, None, None]
    blurred = replace(pair, points=pair.points + levels * rng.standard_normal(pair.points.shape))
    pairs = [own.recording.pair("primary", "secondary") for own in (pair, blurred)]
    even, uneven = (forecast_files(calibrate(own), FEW).draws.further["2d"] for own in pairs)
    # Measured: 0.10 and 0.63.
    assert 0.0 < even.in_images < 0.3 < uneven.in_images
    assert uneven.of_pairs >= uneven.in_images


def test_boards_of_single_corners_have_no_lengths_to_draw() -> None:
    pair = sound(0, frames=16, baseline=True)
    pair.points[3:, 1:] = np.nan
    forecast = forecast_files(calibrate(pair.dataset, refined=RefineSettings()), FEW)
    assert not forecast.draws.further


def test_intervals_of_few_boards_hold_what_these_show() -> None:
    """Whose errors lenses and pose follow: the forecast in the images is 1.08 times as large."""
    pair = sound(0, frames=8, baseline=True)
    found = forecast_files(calibrate(pair.recording.pair("primary", "secondary"))).draws
    for method, own in found.further.items():
        said = found.figures[method].mean_reprojection_px
        shown = own.shown["mean_reprojection_px"]
        assert said.low <= 1.0001 * shown * np.exp(-own.in_images)
