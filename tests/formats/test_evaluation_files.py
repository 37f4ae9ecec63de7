"""What an evaluation leaves behind, read back; and the engines' refusals."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.calibration.methods import METHODS
from stereocal.evaluation.evaluate import EvaluationSettings, RunCounts, evaluate
from stereocal.evaluation.summary import summarise
from stereocal.formats.dataset_files import read_dataset
from stereocal.formats.evaluation_files import (
    Evaluation,
    pack_evaluation,
    summary_json,
    unpack_evaluation,
    validation_figures,
)
from stereocal.system.executors import engine
from tests.refused import refused

FIELD = Path(__file__).parents[2] / "sample_data" / "field"
SETTINGS = EvaluationSettings(runs=6, calibration_frames=20)


@pytest.fixture(scope="module")
def runs() -> list[list[RunCounts]]:
    with ThreadPoolExecutor(2) as executor:
        return evaluate([read_dataset(FIELD)], SETTINGS, executor)


def test_evaluation_comes_back_as_it_was(runs: list[list[RunCounts]]) -> None:
    odd = replace(runs[0][0], lengths=runs[0][0].lengths[:, :2])
    kept = [runs[0], [odd, *runs[0][1:3]]]
    evaluation = Evaluation(kept, SETTINGS, ["one", "two"], ["a", "b"])
    back = unpack_evaluation(pack_evaluation(evaluation))
    assert back.settings == SETTINGS
    assert (list(back.names), list(back.sha256)) == (["one", "two"], ["a", "b"])
    assert [len(of_one) for of_one in back.runs] == [6, 3]
    for before, after in zip(kept, back.runs, strict=True):
        for one, other in zip(before, after, strict=True):
            for name in ("counts", "nans", "lengths", "angles", "correct_px"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


def test_summary_has_what_scripts_read(runs: list[list[RunCounts]]) -> None:
    pooled = summarise(runs)
    dataset = read_dataset(FIELD)
    content = json.loads(summary_json(pooled, {"field": pooled}, [dataset], SETTINGS))
    assert set(content["methods"]) == set(METHODS)
    for method in METHODS:
        figures = content["methods"][method]
        for name in ("fcp_residual", "fcp_reprojection"):
            assert set(figures[name]) == {"value", "low", "high"}
            assert 0 <= figures[name]["low"] <= figures[name]["high"] <= 1
        ratios = np.concatenate([run.lengths[METHODS.index(method)] for run in runs[0]])
        errors = np.abs(ratios - 1)
        assert figures["median_error_3d"] == pytest.approx(np.median(errors))
        assert figures["p95_error_3d"] == pytest.approx(np.percentile(errors, 95))
        assert figures["fraction_above_1_percent"] == pytest.approx((errors > 0.01).mean())
        assert figures["correct_pairs"] == 6 * 10 and figures["wrong_pairs"] == 6 * 90
    assert content["datasets"][0]["sha256"] == dataset.sha256
    assert content["settings"]["runs"] == 6
    assert validation_figures(pooled, SETTINGS)["2d"]["runs"] == 6


@pytest.mark.parametrize(
    ("workers", "scheduler", "said"),
    [(0, None, ("workers", "0")), (1, "tcp://127.0.0.1:1", ("workers", "scheduler"))],
)
def test_engines_refuse(workers: int, scheduler: str | None, said: tuple[str, ...]) -> None:
    with refused(*said), engine(workers, scheduler):
        pass
