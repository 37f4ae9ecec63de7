"""Kept refined fits give the same validation, and runs of frames are left out whole."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.evaluation.evaluate import (
    EvaluationSettings,
    RunCounts,
    Splits,
    clusters_to_split,
    evaluate,
    evaluate_run,
    split,
)
from stereocal.evaluation.growing import GrowingRuns, KeptFits
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.screening.screen import screen
from stereocal.formats.dataset_files import read_dataset
from stereocal.system.tasks import StoppedError
from tests.refused import refused
from tests.rigs import known_rig as rig

SAMPLES = Path(__file__).parents[2] / "sample_data"
FIELD = read_dataset(SAMPLES / "field")
KINDS: tuple[Splits, ...] = ("runs", "frames")
USUAL = EvaluationSettings(runs=5, refined=RefineSettings())


def with_search(**values: float) -> EvaluationSettings:
    search = SearchSettings(**values)  # type: ignore[arg-type]
    return replace(USUAL, calibration=CalibrationSettings(search))


def assert_equal(
    found: Sequence[Sequence[RunCounts]], wanted: Sequence[Sequence[RunCounts]]
) -> None:
    for one, other in zip(found[0], wanted[0], strict=True):
        for each in fields(RunCounts):
            np.testing.assert_allclose(
                getattr(one, each.name), getattr(other, each.name), rtol=1e-7
            )


@pytest.mark.parametrize(
    "settings",
    [
        USUAL,
        with_search(delta=5e-3, acceptance=0.4),
        with_search(seed=3),
        replace(USUAL, calibration_frames=15),
        replace(USUAL, runs=4),
        replace(USUAL, refined=None),
    ],
)
def test_it_is_the_same_validation(settings: EvaluationSettings) -> None:
    kept = KeptFits()
    with ThreadPoolExecutor(2) as executor:
        GrowingRuns(1, USUAL).compute([FIELD], executor, kept)
        found = GrowingRuns(1, settings).compute([FIELD], executor, kept)
        wanted = evaluate([FIELD], settings, executor)
    assert_equal(found, wanted)


def test_other_steps_of_the_search_need_no_new_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = KeptFits()
    with ThreadPoolExecutor(1) as executor:
        GrowingRuns(1, USUAL).compute([FIELD], executor, kept)
        monkeypatch.setattr("stereocal.evaluation.evaluate.refine", None)  # cannot be called
        found = GrowingRuns(1, with_search(delta=5e-3)).compute([FIELD], executor, kept)
    assert found[0][0].angles.shape == (4, 5)


def test_the_first_runs_of_every_data_set_can_be_seen_while_others_are_computed() -> None:
    settings = replace(USUAL, runs=12)
    growing, seen = GrowingRuns(2, settings), []

    def look(_done: int, _total: int) -> None:
        seen.append([[len(own) for own in growing.so_far(refined)] for refined in (False, True)])
        if min(seen[-1][1]) > 0:
            raise StoppedError

    with ThreadPoolExecutor(1) as executor, pytest.raises(StoppedError):
        growing.compute([FIELD, FIELD], executor, KeptFits(), look)
    assert 0 < min(seen[-1][1]) <= max(seen[-1][1]) < settings.runs
    (first, *_), _ = growing.so_far(refined=True)
    assert_equal([[first]], [[evaluate_run(FIELD, settings, 0, 0)]])


def test_runs_are_left_out_whole() -> None:
    recording = screen(read_dataset(SAMPLES / "recording")).dataset
    clusters = clusters_to_split(recording)
    assert clusters is not None
    rows = recording.correspondences
    assert len(clusters) == len(rows.frames)
    of_rows = clusters[np.searchsorted(rows.frames, rows.frame)]
    for seed in range(5):
        fit = split(recording, 300, np.random.SeedSequence(seed), clusters)
        assert not set(of_rows[fit]) & set(of_rows[~fit])
        fitted = len(np.unique(rows.frame[fit]))
        assert 300 - np.bincount(clusters).max() < fitted <= 300


def test_frames_taken_one_by_one_are_split_as_in_the_paper() -> None:
    data = rig.dataset(25, 0.2)
    assert clusters_to_split(data) is None
    runs, frames = (evaluate_run(data, EvaluationSettings(splits=s), 0, 3) for s in KINDS)
    assert_array_equal(runs.counts, frames.counts)
    assert_array_equal(runs.angles, frames.angles)


def test_settings_keep_the_splits_and_old_ones_were_frame_by_frame() -> None:
    for kind in KINDS:
        written = EvaluationSettings(splits=kind).to_json()
        assert EvaluationSettings.from_json(written).splits == kind
    del written["splits"]
    assert EvaluationSettings.from_json(written).splits == "frames"
    with refused("splits", "'some'"):
        EvaluationSettings.from_json({**written, "splits": "some"})
