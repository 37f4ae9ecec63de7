"""The answer to "do I need two sets?" on figures whose answer is known."""

from __future__ import annotations

import numpy as np
import pytest

from stereocal.calibration.methods import Method
from stereocal.evaluation.compiled_run import BINS, CORRECT, WRONG
from stereocal.refined.unknowns import RefineSettings
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.model_check import HeldOutRatio, ModelCheck
from stereocal.verdict.one_or_two_sets import verdict
from stereocal.verdict.predictive import Predictive
from stereocal.workflow import calibrate
from tests.rigs.refined_rigs import Misjudged, random_scene, stated

SETS: tuple[Method, ...] = ("2d", "3d", "refined")


def forecast_with(matching: float, measuring: float, spread: float, draws: int = 400) -> Predictive:
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
    return Predictive(SETS, counts, px, lengths, depths, radii, recorded=25)


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
    assert "the 3D set with 0.20 %" in answer.figures
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
    outlook = forecast_files(calibrate(data, refined=RefineSettings()))
    answer = outlook.verdict
    assert answer.kind == "one"
    assert answer.matching.value < 1
    assert answer.check is not None
    assert answer.check.holds
