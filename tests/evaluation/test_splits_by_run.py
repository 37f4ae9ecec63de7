"""Validation that leaves out whole runs of frames that follow each other."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from stereocal.errors import StereocalError
from stereocal.evaluation.evaluate import (
    EvaluationSettings,
    Splits,
    clusters_to_split,
    evaluate_run,
    split,
)
from stereocal.formats.dataset_files import read_dataset
from stereocal.refined.screening import screen
from stereocal.rig.dataset import Dataset
from tests import known_rig as rig

RECORDING = Path(__file__).parents[2] / "sample_data" / "recording"
KINDS: tuple[Splits, ...] = ("runs", "frames")


@pytest.fixture(scope="module")
def recording() -> Dataset:
    return screen(read_dataset(RECORDING)).dataset


def test_runs_are_left_out_whole(recording: Dataset) -> None:
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
    with pytest.raises(StereocalError, match="splits"):
        EvaluationSettings.from_json({**written, "splits": "some"})
