"""`stereocal evaluate` from the command line: its files, and what other commands do with them."""

import json
import shutil
from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.rig.parameters import RigParameters
from tests.docs.prepared import thin

SAMPLES = Path(__file__).parents[2] / "sample_data"
FIELD, NINETEEN = SAMPLES / "field", SAMPLES / "nineteen"


def test_writes_summary_and_report_and_shows_progress(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--runs", "2", "--calibration-frames", "15", "--essential", "linear"]
    datasets = [str(FIELD), str(NINETEEN / "07")]
    assert main(["evaluate", *datasets, "--out", str(tmp_path / "new"), *options]) == 0
    printed = capsys.readouterr()
    assert "4 runs: done" in printed.err
    assert "Held out here: " in printed.out
    names = {path.name for path in (tmp_path / "new").iterdir()}
    assert names == {"report.html", "summary.json"}
    summary = json.loads((tmp_path / "new" / "summary.json").read_text())
    assert summary["methods"].keys() >= {"essential", "2d", "3d"}
    assert len(summary["datasets"]) == 2
    settings = summary["settings"]
    assert (settings["runs"], settings["calibration_frames"]) == (2, 15)
    assert settings["essential"] == "linear"
    fcp = summary["methods"]["2d"]["fcp_reprojection"]
    assert 0 <= fcp["low"] <= fcp["value"] <= fcp["high"] <= 1
    report = (tmp_path / "new" / "report.html").read_text()
    assert "Plotly.newPlot" in report
    for remote in ('src="http', "src='http", 'href="http', "@import"):
        assert remote not in report.split("Plotly.newPlot")[0][:2000]


def test_figures_reach_the_parameter_files(tmp_path: Path) -> None:
    out, summary = ["--no-refined", "--out", str(tmp_path)], tmp_path / "summary.json"
    assert main(["evaluate", str(FIELD), *out, "--runs", "4"]) == 0
    assert main(["calibrate", str(FIELD), *out, "--validation", str(summary)]) == 0
    threshold = RigParameters.load(tmp_path / "parameters_2d.json").matching_threshold_px
    assert threshold is not None
    assert threshold == json.loads(summary.read_text())["methods"]["2d"]["threshold_px"]


def test_two_cameras_of_a_rig_are_evaluated(tmp_path: Path) -> None:
    """Their known lengths are of an object with three targets, not of a bar."""
    thin(few := Path(shutil.copytree(SAMPLES / "rig", tmp_path / "rig")))
    options = ["--pair", "2-3", "--runs", "1", "--no-refined", "--out", str(tmp_path)]
    assert main(["evaluate", str(few), *options]) == 0
    assert "<td>0.39 m</td>" in (tmp_path / "report.html").read_text()
