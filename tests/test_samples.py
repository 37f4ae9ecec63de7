"""All files that are computed from a sample name the same data, whatever was left out of them."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal import CalibrationSettings
from stereocal.calibration.methods import FILE_METHODS
from stereocal.cli import main
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.small_steps import window_at
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.dataset_files import read_dataset, read_recording
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair
from stereocal.rig.window import StatedWindow
from stereocal.system.resources import ROOT
from stereocal.workflow.pair_run import PairRun
from tests.further import further
from tests.rig.test_pair import check_same

SAMPLES = ROOT / "sample_data"
DESCRIBED = sorted(path.parent.relative_to(SAMPLES) for path in SAMPLES.rglob("dataset.json"))
WINDOWED = "tank"
POINTS = [
    str(name)
    for name in DESCRIBED
    if (SAMPLES / name / "correspondences.csv").exists() and str(name) != WINDOWED
]
PHOTOGRAPHS = [
    str(name)
    for name in DESCRIBED
    if (SAMPLES / name / "primary").is_dir() and str(name) != WINDOWED
]


def in_the_soak(*names: str) -> list[object]:
    return [pytest.param(name, marks=pytest.mark.soak) for name in names]


def check(dataset: Pair) -> None:
    """One frame is left out, and others where they contradict the rest."""
    left_out = int(dataset.correspondences.frames[1])
    found = PairRun(dataset, CalibrationSettings(frames_left_out=(left_out,))).calibration
    assert found.refined is not None
    named = {method: found.parameters(method).inputs["sha256"] for method in FILE_METHODS}
    assert named == dict.fromkeys(FILE_METHODS, dataset.sha256)


def test_every_sample_with_data_is_tested() -> None:
    assert {*map(str, DESCRIBED)} == {*POINTS, *PHOTOGRAPHS, WINDOWED, "rig"}
    assert len(POINTS) == 22 and {*PHOTOGRAPHS} == {"balls", "photographs"}


@pytest.mark.parametrize(
    "name",
    [*(name for name in POINTS if "/" not in name), *in_the_soak(*(n for n in POINTS if "/" in n))],
)
def test_a_table_of_points(name: str) -> None:
    dataset = read_dataset(SAMPLES / name)
    check_same(dataset.recording.pair(*CAMERAS), dataset)
    check(dataset)


@pytest.mark.parametrize("pair", ["1-2", *in_the_soak("1-3", "2-3")])
def test_a_pair_of_three_cameras(pair: str) -> None:
    check(pair_to_calibrate(read_recording(SAMPLES / "rig"), pair))


@pytest.mark.soak
@pytest.mark.parametrize("name", PHOTOGRAPHS)
def test_photographs(name: str, tmp_path: Path) -> None:
    for file in (SAMPLES / name).glob("*.json"):
        shutil.copy(file, tmp_path)
    target = ["--target", "balls:red,yellow"] if name == "balls" else []
    table = str(tmp_path / "correspondences.csv")
    assert main(["detect", str(SAMPLES / name), "--out", table, *target]) == 0
    check(read_dataset(tmp_path))


def test_points_in_a_tank() -> None:
    folder = SAMPLES / WINDOWED
    described = json.loads((folder / "dataset.json").read_text())
    truth = json.loads((folder / "truth.json").read_text())
    stated = StatedWindow(**{**described["window"], "cameras": CAMERAS})
    rig = calibrate_rig(replace(read_recording(folder), windows=(stated,)))
    assert not (rig.warnings or rig.left_out or rig.wrong)
    # Measured: 0.11 mm, 0.09 and 0.33 mm, 0.04 and 0.03 degrees, 0.014 %.
    assert rig.poses["secondary"].baseline == pytest.approx(np.linalg.norm(truth["T"]), abs=5e-4)
    for number, true in enumerate(truth["windows"].values()):
        found = window_at(rig.fit.at, number)
        assert found is not None
        assert found.distance_m == pytest.approx(true["distance_m"], abs=1e-3)
        assert np.abs(np.subtract(found.normal, true["normal"])).max() < 2e-3
    assert np.abs(rig.length_errors).mean() < 3e-4


@pytest.mark.soak
def test_a_file_of_another_program(tmp_path: Path) -> None:
    file = SAMPLES / "archives" / "flight_easyWandData.mat"
    assert main(["import", str(file), "--out", str(tmp_path)]) == 0
    check(read_dataset(tmp_path))


@pytest.mark.soak
@pytest.mark.parametrize("name", ["rig", *further("by_hand")])
def test_a_rig_and_its_pairs(name: str, tmp_path: Path) -> None:
    data, out = tmp_path / "data", tmp_path / "out"
    assert main(["sample", name, "--out", str(data)]) == 0
    if name == "by_hand":
        assert main(["sync", str(data), "--out", str(tmp_path / "in_step")]) == 0
        data = tmp_path / "in_step"
    assert main(["rig", str(data), "--pairs", "--out", str(out)]) == 0
    files = [*out.glob("*.json")]
    assert len(files) == 10
    digests = {json.loads(file.read_text())["inputs"]["sha256"] for file in files}
    assert digests == {read_recording(data).sha256}
