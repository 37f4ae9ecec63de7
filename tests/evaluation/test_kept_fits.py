"""Validation with refined fits from memory is the same validation."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.evaluation.evaluate import EvaluationSettings, Run, evaluate
from stereocal.evaluation.kept_fits import KeptFits, evaluate_with_kept_fits
from stereocal.formats.dataset_files import read_dataset
from stereocal.refined.unknowns import RefineSettings

FIELD = read_dataset(Path(__file__).parents[2] / "sample_data" / "field")
USUAL = EvaluationSettings(runs=12, refined=RefineSettings())


def with_search(**values: float) -> EvaluationSettings:
    search = SearchSettings(**values)  # type: ignore[arg-type]
    return replace(USUAL, calibration=CalibrationSettings(search))


def assert_equal(found: Sequence[Sequence[Run]], wanted: Sequence[Sequence[Run]]) -> None:
    for one, other in zip(found[0], wanted[0], strict=True):
        for each in fields(Run):
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
        replace(USUAL, runs=11),
        replace(USUAL, refined=None),
    ],
)
def test_it_is_the_same_validation(settings: EvaluationSettings) -> None:
    kept = KeptFits()
    with ThreadPoolExecutor(2) as executor:
        evaluate_with_kept_fits([FIELD], USUAL, executor, kept)
        found = evaluate_with_kept_fits([FIELD], settings, executor, kept)
        wanted = evaluate([FIELD], settings, executor)
    assert wanted is not None
    assert_equal(found, wanted)


def test_other_steps_of_the_search_need_no_new_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = KeptFits()
    with ThreadPoolExecutor(1) as executor:
        evaluate_with_kept_fits([FIELD], USUAL, executor, kept)
        monkeypatch.setattr("stereocal.evaluation.evaluate.refine", None)  # cannot be called
        found = evaluate_with_kept_fits([FIELD], with_search(delta=5e-3), executor, kept)
    assert found[0][0].angles.shape == (4, 5)
