"""A project as one zip: it opens elsewhere with all it had, and no zip leads out of its folder."""

from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.errors import StereocalError
from stereocal.formats.inputs import read_input
from stereocal.projects.archive import pack_project
from tests.projects.test_project import FIELD, filled


def test_the_command_line_opens_it(tmp_path: Path) -> None:
    project = filled(tmp_path)
    path = tmp_path / "project.zip"
    pack_project(project, path)
    assert read_input(path).sha256 == read_input(FIELD).sha256
    with pytest.raises(StereocalError, match="as a zip"):
        read_input(project.database.path)
    assert main(["calibrate", str(path), "--out", str(tmp_path / "out"), "--runs", "0"]) == 0
    assert (tmp_path / "out" / "parameters_3d.json").is_file()
