"""The answer to "do I need two sets?" on figures whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.refined_rigs import Misjudged, random_scene, stated
from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.calibration.results import errors_of
from stereocal.errors import StereocalError
from stereocal.evaluation.compiled_run import BINS, CORRECT, WRONG
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate_run, split
from stereocal.refined.refine import refine
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.geometry import Angles, Pose
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.one_or_two_sets import HeldOut, held_out, run_splits, verdict
from stereocal.verdict.predictive import Predictive
from stereocal.workflow import calibrate
from tests import known_rig as rig

SETS: tuple[Method, ...] = ("2d", "3d", "refined")


def forecast_with(matching: float, measuring: float, spread: float, draws: int = 400) -> Predictive:
    """Draws in which the refined set is worse by these factors than each job's own set."""
    rng = np.random.default_rng(1)
    noise = np.exp(spread * rng.normal(size=(2, draws, 1)))
    counts = np.zeros((draws, 2, 3, 2, 2, BINS + 2), dtype=np.int32)
    counts[..., WRONG, 700], counts[..., CORRECT, 500] = 9, 10
    px = np.ones((draws, 2, 3)) * np.array([0.1, 3.0, 0.1])
    px[:, :, 2] *= matching * noise[0]
    error = np.ones((draws, 2, 3)) * np.array([0.01, 0.002, 0.002])
    error[:, :, 2] *= measuring * noise[1]
    return Predictive(SETS, counts, px, 1.0 + np.repeat(error[..., None], 20, axis=3))


def runs_with(px: float, length: float, runs: int = 20) -> list[HeldOut]:
    """Splits whose refined set has these errors on held-out frames."""
    return [HeldOut(20, 5, np.array([0.1, 3.0, px]), np.array([0.01, 0.002, length]))] * runs


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
    assert "the 3D set with 0.20 %" in answer.text
    assert answer.check is None


def test_wide_intervals_ask_for_frames_and_still_name_files() -> None:
    answer = verdict(forecast_with(0.9, 0.9, spread=0.15), 25)
    assert answer.kind == "level"
    assert answer.frames_to_add is not None
    assert f"About {answer.frames_to_add} more frames" in answer.text
    assert "Match and measure with the refined set" in answer.text
    wider = verdict(forecast_with(0.9, 0.9, spread=0.2), 25)
    assert wider.frames_to_add is not None
    assert wider.frames_to_add > answer.frames_to_add > 0
    hopeless = verdict(forecast_with(1.1, 0.9, spread=0.5), 25)
    assert hopeless.frames_to_add is None


def test_a_model_that_does_not_hold_decides_for_no_single_set() -> None:
    one = forecast_with(0.8, 0.9, 0.02)
    px, length = one.forecasts["refined"].mean_reprojection_px.value, 0.0018
    sound = verdict(one, 25, runs_with(1.05 * px, 1.0 * length))
    assert sound.kind == "one"
    assert sound.check is not None
    assert sound.check.holds
    doubted = verdict(one, 25, runs_with(2.0 * px, 1.0 * length))
    assert doubted.kind == "level"
    assert doubted.check is not None
    assert doubted.check.matching == pytest.approx(2.0, rel=0.01)
    assert "does not explain these images" in doubted.text
    # Two sets are needed the more so.
    assert verdict(forecast_with(2.0, 0.9, 0.02), 25, runs_with(2.0, length)).kind == "two"


def test_figures_of_a_run() -> None:
    """Of an evaluation's run, against the errors of the same sets on the same frames."""
    data = rig.dataset(20, 0.2)
    protocol = EvaluationSettings(runs=1, calibration_frames=15, refined=RefineSettings())
    run = evaluate_run(data, protocol, 0, 0)
    figures = held_out(run, data, 15)
    assert (figures.fitted_frames, figures.tested_frames) == (15, 5)
    fit = split(data, 15, np.random.SeedSequence([0, 0, 0]).spawn(4)[0])
    test = data.of_frames(np.unique(data.correspondences.frame[~fit]))
    for at, row in ((0, 1), (1, 2)):
        pose = Pose.from_angles(Angles(*run.angles[row].tolist()), data.baseline_m)
        errors = errors_of(test, pose)
        assert figures.matching_px[at] == pytest.approx(errors.mean_reprojection_px)
        assert figures.length[at] == pytest.approx(errors.mean_length)
    start = Pose.from_angles(Angles(*run.angles[0].tolist()), data.baseline_m)
    found = refine(data, RefineSettings(), start, fit)
    own = errors_of(found.apply(test), found.pose)
    assert figures.matching_px[2] == pytest.approx(own.mean_reprojection_px)
    assert figures.length[2] == pytest.approx(own.mean_length)
    with pytest.raises(StereocalError, match="refined"):
        held_out(evaluate_run(data, replace(protocol, refined=None), 0, 0), data, 15)


def test_from_data_to_verdict() -> None:
    """Lenses off: one set does both, for it alone can move the lenses."""
    rng = np.random.default_rng(21)
    data = stated(random_scene(rng, 60), rng, Misjudged(noise_px=0.05))
    seen: list[int] = []
    settings = CalibrationSettings()
    runs = run_splits(
        data, settings, RefineSettings(), 12, progress=lambda done, total: seen.append(done + total)
    )
    assert runs is not None
    assert seen == list(range(13, 25))
    assert (runs[0].fitted_frames, runs[0].tested_frames) == (48, 12)
    outlook = forecast_files(calibrate(data, settings, refined=RefineSettings()))
    answer = verdict(outlook.predictive, 60, runs)
    assert answer.kind == "one"
    assert answer.matching.value < 1
    assert answer.check is not None
    assert answer.check.holds
    again = run_splits(data, settings, RefineSettings(), 2)
    assert again is not None
    np.testing.assert_array_equal(again[1].length, runs[1].length)
    assert run_splits(data, settings, RefineSettings(), 2, cancelled=lambda: True) is None


def test_it_refuses_a_forecast_without_the_refined_set() -> None:
    whole = forecast_with(1.0, 1.0, 0.1, draws=4)
    without = Predictive(
        ("2d", "3d"), whole.counts[:, :, :2], whole.correct_px[:, :, :2], whole.lengths[:, :, :2]
    )
    with pytest.raises(StereocalError, match="refined"):
        verdict(without, 25)
