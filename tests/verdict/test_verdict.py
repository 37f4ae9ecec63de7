"""The answer to "do I need two sets?" on figures whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.refined_rigs import Misjudged, random_scene, stated
from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.results import errors_of
from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate_run, split
from stereocal.refined.refine import refine
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.geometry import Angles, Pose
from stereocal.verdict.one_or_two_sets import HeldOut, held_out, run_splits, verdict
from tests import known_rig as rig


def runs_of(
    matching: float, measuring: float, spread: float, runs: int = 40, frames: int = 25
) -> list[HeldOut]:
    """Runs whose refined set is worse by these factors than each job's own set."""
    rng = np.random.default_rng(1)
    found = []
    for _ in range(runs):
        noise = np.exp(spread * rng.normal(size=2))
        found.append(
            HeldOut(
                fitted_frames=frames - 5,
                tested_frames=5,
                matching_px=np.array([0.1, 3.0, 0.1 * matching * noise[0]]),
                length=np.array([0.01, 0.002, 0.002 * measuring * noise[1]]),
            )
        )
    return found


@pytest.mark.parametrize(
    ("matching", "measuring", "kind", "words"),
    [
        (0.8, 0.9, "one", "One refined set does both jobs"),
        (1.0, 1.0, "one", "One refined set does both jobs"),
        (2.0, 0.9, "two", "Two sets are worth it on this rig"),
        (0.9, 1.5, "two", "Two sets are worth it on this rig"),
    ],
)
def test_clear_cases(matching: float, measuring: float, kind: str, words: str) -> None:
    answer = verdict(runs_of(matching, measuring, spread=0.05))
    assert answer.kind == kind
    assert answer.text.startswith(words)
    assert answer.frames_to_add is None
    assert answer.matching.low < matching < answer.matching.high
    assert answer.measuring.low < measuring < answer.measuring.high
    assert answer.matching_px[:2] == (0.1, 3.0)
    assert "the 3D set with 0.20 %" in answer.text


def test_wide_intervals_ask_for_frames() -> None:
    answer = verdict(runs_of(0.9, 0.9, spread=0.5))
    assert answer.kind == "few"
    assert answer.frames_to_add is not None
    assert answer.text.startswith(
        f"Too few frames to tell: add about {answer.frames_to_add}. So far the refined set"
    )
    wider = verdict(runs_of(0.9, 0.9, spread=0.7))
    assert wider.frames_to_add is not None
    assert wider.frames_to_add > answer.frames_to_add > 0
    # Intervals narrow with the root of the frames; so many more bring both below the limit.
    narrower = np.sqrt(25 / (25 + answer.frames_to_add))
    for ratio in (answer.matching, answer.measuring):
        assert ratio.value * (ratio.high / ratio.value) ** narrower <= 1.1
    hopeless = verdict(runs_of(1.1, 0.9, spread=0.5))
    assert hopeless.frames_to_add is None
    assert "add more than 250" in hopeless.text


def test_the_interval_holds_the_truth() -> None:
    """The mean of dependent runs: the frames of each test are 1/5 of the same pool."""
    rng = np.random.default_rng(4)
    held = 0
    for _ in range(200):
        frames = rng.normal(size=25) * 0.3  # log ratio of each frame, mean 0
        runs = []
        for _ in range(30):
            mean = frames[rng.permutation(25)[:5]].mean()
            runs.append(
                HeldOut(20, 5, np.array([1.0, 1.0, np.exp(mean)]), np.array([1.0, 1.0, 1.0]))
            )
        answer = verdict(runs).matching
        held += answer.low <= 1.0 <= answer.high
    # Measured on 1,000: 93.6 %; the interval that ignores the overlap, 48.4 %.
    assert held >= 180


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
    answer = verdict(runs)
    assert answer.kind == "one"
    assert answer.matching.value < 1
    again = run_splits(data, settings, RefineSettings(), 2)
    assert again is not None
    np.testing.assert_array_equal(again[1].length, runs[1].length)
    assert run_splits(data, settings, RefineSettings(), 2, cancelled=lambda: True) is None


def test_what_it_refuses() -> None:
    with pytest.raises(StereocalError, match="at least 10 runs; there are 3"):
        verdict(runs_of(1.0, 1.0, 0.1, runs=3))
    without = [
        HeldOut(20, 5, run.matching_px, np.full(3, np.nan)) for run in runs_of(1.0, 1.0, 0.1)
    ]
    with pytest.raises(StereocalError, match="both targets"):
        verdict(without)
