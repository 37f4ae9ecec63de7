"""`stereocal evaluate` and `simulate` from the command line: files, engines, bad input."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from stereocal.cli import main
from stereocal.rig.parameters import RigParameters

SAMPLES = Path(__file__).parents[2] / "sample_data"
FIELD, NINETEEN = SAMPLES / "field", SAMPLES / "nineteen"


@pytest.fixture(scope="module")
def threads(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The summary of 12 runs, computed in threads."""
    return evaluated(tmp_path_factory.mktemp("threads"))


def evaluated(out: Path, *options: str) -> Path:
    assert main(["evaluate", str(FIELD), "--out", str(out), "--runs", "12", *options]) == 0
    return out / "summary.json"


def figures(summary: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(summary.read_text())["methods"]
    return found


def test_writes_summary_and_report_and_shows_progress(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--runs", "7", "--calibration-frames", "15", "--essential", "linear"]
    datasets = [str(FIELD), str(NINETEEN / "07")]
    assert main(["evaluate", *datasets, "--out", str(tmp_path / "new"), *options]) == 0
    printed = capsys.readouterr()
    assert "14/14 runs" in printed.err
    assert "Match with the" in printed.out
    assert sorted(path.name for path in (tmp_path / "new").iterdir()) == [
        "report.html",
        "summary.json",
    ]
    summary = json.loads((tmp_path / "new" / "summary.json").read_text())
    assert summary["methods"].keys() >= {"essential", "2d", "3d"}
    assert len(summary["datasets"]) == 2
    settings = summary["settings"]
    assert (settings["runs"], settings["calibration_frames"]) == (7, 15)
    assert settings["essential"] == "linear"
    fcp = summary["methods"]["2d"]["fcp_reprojection"]
    assert 0 <= fcp["low"] <= fcp["value"] <= fcp["high"] <= 1
    report = (tmp_path / "new" / "report.html").read_text()
    assert "Plotly.newPlot" in report
    for remote in ('src="http', "src='http", 'href="http', "@import"):
        assert remote not in report.split("Plotly.newPlot")[0][:2000]


def test_figures_reach_the_parameter_files(threads: Path, tmp_path: Path) -> None:
    options = ["--out", str(tmp_path), "--validation", str(threads)]
    assert main(["calibrate", str(FIELD), *options]) == 0
    matching = RigParameters.load(tmp_path / "parameters_2d.json")
    assert matching.matching_threshold_px is not None
    assert matching.matching_threshold_px == figures(threads)["2d"]["threshold_px"]
