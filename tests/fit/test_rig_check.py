"""Which camera of a rig has moved: `check` with rig.json."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stereocal.cli import main
from stereocal.commands.photographs import write_recording
from stereocal.field.checking.rig_check import check_rig
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.rig.recording import Recording
from stereocal.simulation.rigs import SimulatedRig, simulated_rig
from tests.further import further
from tests.refused import refused
from tests.rigs.mistakes import bumped_from


@pytest.fixture(scope="module")
def truth() -> SimulatedRig:
    return simulated_rig(np.random.default_rng(11), 4, 240)


@pytest.fixture(scope="module")
def rig(truth: SimulatedRig) -> RigFile:
    return rig_file(calibrate_rig(truth.recording.where(truth.recording.frame < 160)))


def later(recording: Recording) -> Recording:
    return recording.where((recording.frame >= 160) & (recording.frame < 200))


def test_nothing_has_moved_and_points_left_out_of_the_new_images_are_told_once(
    truth: SimulatedRig, rig: RigFile
) -> None:
    seen = {"c1": 0, "c2": 3, "c3": 0, "c4": 0}
    found = check_rig(rig, replace(later(truth.recording), beyond_view=seen))
    assert found.verdict != "moved"
    assert found.explanations == ((),)
    assert found.moved == ()
    assert sum("Left out: 3 points of camera c2," in note for note in found.notes) == 1


def test_the_recording_of_the_calibration_shows_no_movement_since(
    truth: SimulatedRig, rig: RigFile
) -> None:
    own = truth.recording.where(truth.recording.frame < 160)
    found = check_rig(rig, own)
    assert found.verdict == "cannot tell"
    assert found.sentence.startswith("Cannot tell with these: the parameters come from these")


@pytest.mark.parametrize("name", further("c3", "c1"))  # the command names one below
def test_a_turned_camera_is_named(truth: SimulatedRig, rig: RigFile, name: str) -> None:
    # 0.1 degree is 2 px in the image, against 0.3 px of noise
    found = check_rig(rig, later(bumped_from(truth, name, 0.1, 160)))
    assert found.verdict == "moved"
    assert found.moved == (name,)
    assert f"camera {name}" in found.sentence


def test_two_turned_cameras_are_named(truth: SimulatedRig, rig: RigFile) -> None:
    once = replace(truth, recording=bumped_from(truth, "c1", 0.2, 160))
    found = check_rig(rig, later(bumped_from(once, "c4", -0.2, 160)))
    assert found.moved == ("c1", "c4")


def test_of_two_cameras_it_cannot_be_told_which(truth: SimulatedRig, rig: RigFile) -> None:
    found = check_rig(rig, later(bumped_from(truth, "c2", 0.2, 160)).of_cameras(["c2", "c3"]))
    assert found.verdict == "moved"
    assert found.moved == ()
    assert found.explanations == (("c2",), ("c3",))
    assert "cannot be told which" in found.sentence


def test_other_cameras_cannot_be_checked(truth: SimulatedRig, rig: RigFile) -> None:
    rows = later(truth.recording)
    names = dict(zip(["a", "b", "c", "d"], rows.cameras.values(), strict=True))
    with refused("simulated", "c1, c2, c3 and c4", "a, b, c and d"):
        check_rig(rig, replace(rows, cameras=names))


def test_the_command_takes_a_rig(
    truth: SimulatedRig, rig: RigFile, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.json").write_text(rig.dumps(), encoding="utf-8")
    write_recording(tmp_path / "new", later(bumped_from(truth, "c2", 0.1, 160)))
    arguments = ["check", str(tmp_path / "rig.json"), str(tmp_path / "new")]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    answer = json.loads((tmp_path / "out" / "check.json").read_text(encoding="utf-8"))
    assert answer["verdict"] == "moved"
    assert answer["cameras_moved"] == ["c2"]
    assert {*answer["pairs"]} == {"c1-c2", "c1-c3", "c1-c4", "c2-c3", "c2-c4", "c3-c4"}
    assert "Moved or refocused: camera c2." in capsys.readouterr().out
