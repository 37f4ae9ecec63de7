"""Single frames and whole runs left out: a difference beyond the intervals is stated."""

from __future__ import annotations

from typing import get_args

import numpy as np
import pytest

from stereocal.evaluation.evaluate import EvaluationSettings, Splits, evaluate_runs
from stereocal.evaluation.summary import summarise
from stereocal.rig.dataset import Dataset
from stereocal.verdict.splits import note_on_splits
from tests.rigs.refined_rigs import (
    Misjudged,
    random_rig,
    smooth_fields,
    stated,
    waved_scene,
    with_waves,
)


def recorded(length: int, seed: int = 1) -> Dataset:
    """200 frames of a bar through lenses with smooth errors, at another place every `length`."""
    rng = np.random.default_rng([seed, 27])
    scene = waved_scene(random_rig(rng), rng, 200, length)
    data = stated(scene, rng, Misjudged(0.0, 0.0, 0.0, 0.0, 0.1))
    return with_waves(data, smooth_fields(rng), 1.0)


def note(data: Dataset, splits: Splits) -> str:
    settings = EvaluationSettings(runs=40, calibration_frames=160, splits=splits)
    runs = evaluate_runs(data, settings, 0, range(settings.runs))
    return note_on_splits(data, settings, summarise([runs]))


@pytest.mark.parametrize("splits", get_args(Splits))
def test_a_difference_is_stated_whichever_was_evaluated(splits: Splits) -> None:
    assert "Rely on the figures of whole runs" in note(recorded(20), splits)


def test_frames_taken_one_by_one_have_nothing_to_compare() -> None:
    assert note(recorded(1), "runs") == ""
