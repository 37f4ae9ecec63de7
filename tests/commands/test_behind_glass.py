"""Recordings through windows on the command line and in the library."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import stereocal
from stereocal import cli
from stereocal.formats.dataset_files import pack_recording
from stereocal.rig.recording import REFINED_ONLY
from stereocal.workflow.run import USUAL_FILE, Run
from tests.files import write
from tests.refused import refused
from tests.rigs.behind_glass import Tank, submerged

TANK = submerged(Tank(), np.random.default_rng(3), bars=60)


@pytest.fixture
def recorded(tmp_path: Path) -> Path:
    write(pack_recording(TANK.asked()), tmp_path / "tank")
    return tmp_path / "tank"


NOT_THERE = ["--pairs", "--no-refined", "--kit", "--runs=5", "--known-points", "--pair=c1-c2"]


@pytest.mark.parametrize("option", NOT_THERE)
def test_what_needs_an_essential_matrix_is_refused(
    option: str, recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert cli.main(["calibrate", str(recorded), "--out", str(out), option]) == 2
    assert REFINED_ONLY in capsys.readouterr().err and not out.exists()


@pytest.mark.parametrize("command", [["evaluate"], ["rig", "--pairs"]])
def test_other_commands_refuse_it(
    command: list[str], recorded: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*command, str(recorded), "--out", str(tmp_path / "out")]) == 2
    assert REFINED_ONLY in capsys.readouterr().err


def test_cameras_started_by_hand_are_not_brought_into_step_behind_a_window(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    files = pack_recording(replace(TANK.asked(), own_frames=True))
    recorded = tmp_path / "tank"
    write(files, recorded)
    for command in ("sync", "calibrate"):
        assert cli.main([command, str(recorded), "--out", str(tmp_path / "out")]) == 2
        assert '"start_frames" in dataset.json' in capsys.readouterr().err


def test_the_library_calibrates_all_cameras(recorded: Path) -> None:
    read = stereocal.read(recorded)
    assert isinstance(read, stereocal.Recording) and read.has_windows
    rig = stereocal.calibrate(read)
    assert isinstance(rig, stereocal.RigFile)
    assert [camera.window is not None for camera in rig.cameras.values()] == [True, True]
    for given in (read, read.pair("c1", "c2")):
        with refused(REFINED_ONLY):
            stereocal.calibrate(given, refined=None)
        with refused(REFINED_ONLY):
            stereocal.evaluate([given])


def test_the_file_of_two_cameras_has_its_usual_name_too() -> None:
    files = Run(TANK.asked()).pair_files
    assert [*files] == ["c1-c2_refined.json", USUAL_FILE]
    assert len({*files.values()}) == 1
    assert stereocal.RigParameters.loads(files[USUAL_FILE].decode()).has_windows
