"""An archive gives the same parameter files again, and what differs is named."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from stereocal.calibration.methods import CalibrationSettings, Method
from stereocal.calibration.montecarlo import SearchSettings
from stereocal.cli import main
from stereocal.paper_kit.digests import ADJUSTED, SEARCHED, differences, digest_of
from stereocal.paper_kit.reproduction import archive_files
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.parameters import RigParameters
from stereocal.system.zip_files import pack_zip
from stereocal.workflow import Answer
from tests.paper_kit.answers import answer_of, of_field, of_recording

ROOT = Path(__file__).parents[2]
IDENTICAL = [f"parameters_{method}.json: identical" for method in ("2d", "3d", "refined")]


def archive(tmp_path: Path, edit: Callable[[dict[str, bytes]], None] = lambda _: None) -> str:
    """The archive of the field sample, with other files in it."""
    files = archive_files(of_field(), of_field().sets)
    edit(files)
    path = tmp_path / "archive.zip"
    path.write_bytes(pack_zip(files))
    return str(path)


def stated(files: dict[str, bytes], edit: Callable[[Any], None]) -> None:
    content = json.loads(files["reproduce.json"])
    edit(content)
    files["reproduce.json"] = json.dumps(content).encode()


def reproduce(path: str, tmp_path: Path) -> int:
    return main(["reproduce", path, "--out", str(tmp_path / "again")])


@pytest.mark.parametrize("answer", [of_field, pytest.param(of_recording, marks=pytest.mark.soak)])
def test_another_process_gives_the_same_digests(
    answer: Callable[[], Answer], tmp_path: Path
) -> None:
    files = archive_files(answer(), answer().sets)
    path, again = tmp_path / "archive.zip", tmp_path / "again"
    path.write_bytes(pack_zip(files))
    command = [sys.executable, "-m", "stereocal", "reproduce", str(path), "--out", str(again)]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    assert all(line in run.stdout for line in IDENTICAL)
    for name in ("parameters_2d.json", "parameters_refined.json"):
        archived, now = (json.loads(each) for each in (files[name], (again / name).read_bytes()))
        assert digest_of(archived) == digest_of(now)


def test_settings_and_a_replaced_file_come_along(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = CalibrationSettings(SearchSettings(seed=5), "linear", frames_left_out=(2,))
    dataset = of_field().calibration.dataset
    found = answer_of(dataset, settings, runs=2, refined=RefineSettings())
    sets: dict[Method, RigParameters] = {"2d": found.sets["refined"], "3d": found.sets["3d"]}
    path = tmp_path / "archive.zip"
    path.write_bytes(pack_zip(archive_files(found, sets)))
    assert reproduce(str(path), tmp_path) == 0
    printed = capsys.readouterr().out
    assert all(line in printed for line in IDENTICAL[:2])
    again = json.loads((tmp_path / "again" / "parameters_2d.json").read_text())
    assert again["method"] == "refined"


def test_a_changed_point_is_different(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def edit(files: dict[str, bytes]) -> None:
        head, first, *rows = files["correspondences.csv"].decode().splitlines()
        cells = first.split(",")
        cells[2] = f"{float(cells[2]) + 0.001!r}"
        files["correspondences.csv"] = "\n".join([head, ",".join(cells), *rows]).encode()

    assert reproduce(archive(tmp_path, edit), tmp_path) == 1
    printed = capsys.readouterr().out
    for method in ("2d", "3d", "refined"):
        assert f"parameters_{method}.json: different" in printed
    assert "inputs.sha256" in printed


def test_a_forged_archive_cannot_bring_its_own_tolerance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def edit(files: dict[str, bytes]) -> None:
        forged = json.loads(files["parameters_refined.json"])
        forged["baseline_m"] *= 1.5
        forged["predicted"]["median_error_3d"]["value"] *= 0.5
        files["parameters_refined.json"] = json.dumps(forged).encode()

        def own(content: Any) -> None:
            entry = content["files"]["parameters_refined.json"]
            entry["sha256"] = digest_of(forged)
            entry["tolerance"] = {"parameters": 0.99, "figures": 0.99}

        stated(files, own)

    assert reproduce(archive(tmp_path, edit), tmp_path) == 1
    printed = capsys.readouterr().out
    assert f"parameters_refined.json: different, in 2 values beyond the tolerance ({ADJUSTED})" in (
        printed
    )
    assert "baseline_m" in printed and "predicted.median_error_3d.value" in printed


BASE: dict[str, Any] = {
    "R": [[1.0, 0.0], [0.0, 1.0]],
    "cost": 2.0,
    "settings": {"seed": 3, "essential": "linear"},
    "frames_left_out": [1, 2],
    "recommendation": {"text": "Below 0.91 px, 0.60 %."},
    "created": "today",
    "validation": None,
}


def test_searched_sets_have_a_wider_tolerance() -> None:
    other = {**BASE, "R": [[1.0, 5e-5], [0.0, 1.0]], "cost": 2.05}
    assert len(differences(BASE, other, ADJUSTED)) == 2
    assert not differences(BASE, other, SEARCHED)
