"""A project as one zip: it opens elsewhere with all it had, and no zip leads out of its folder."""

import zipfile
from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.errors import StereocalError
from stereocal.formats.inputs import read_input
from stereocal.projects.application import ProjectApplication
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.rig.parameters import RigParameters
from tests.projects.test_project import FIELD, filled
from tests.projects.test_projects import calibrated


def test_inputs_settings_and_results_come_along(tmp_path: Path) -> None:
    project = calibrated(tmp_path / "here")
    project.rename("Swifts")
    project.keep_settings({"delta": 0.002})
    survey = (FIELD.parent / "world" / "survey.csv").read_bytes()
    rig = RigParameters.load(FIELD.parent / "world" / "parameters_3d.json")
    ProjectApplication(project).keep_world("survey.csv", survey, rig)
    path = tmp_path / "swifts.zip"
    pack_project(project, path)
    with zipfile.ZipFile(path) as archive:
        assert "dataset.json" in archive.namelist()
    there = unpack_project(path, path.name, tmp_path / "there")
    assert there.id != project.id
    assert there.inputs == project.inputs
    assert there.settings["delta"] == 0.002
    world = ProjectApplication(there).world_file
    assert world is not None and world.read_bytes() == survey
    before, after = project.calibration, there.calibration
    assert before is not None and after is not None
    assert after.methods["3d"].cost == before.methods["3d"].cost
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["swifts.zip"]


def test_the_command_line_opens_it(tmp_path: Path) -> None:
    project = filled(tmp_path)
    path = tmp_path / "project.zip"
    pack_project(project, path)
    assert read_input(path).sha256 == read_input(FIELD).sha256
    with pytest.raises(StereocalError, match="as a zip"):
        read_input(project.database.path)
    assert main(["calibrate", str(path), "--out", str(tmp_path / "out"), "--runs", "0"]) == 0
    assert (tmp_path / "out" / "parameters_3d.json").is_file()
