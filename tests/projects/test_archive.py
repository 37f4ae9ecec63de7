"""A project as one zip: it opens elsewhere with all it had, and no zip leads out of its folder."""

from __future__ import annotations

import io
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.errors import StereocalError
from stereocal.formats.inputs import read_input
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.project import Project
from tests.pages.stored_projects import FULL
from tests.projects.test_project import FIELD, filled
from tests.projects.test_projects import calibrated


def packed(project: Project, target: Path) -> Path:
    pack_project(project, target)
    return target


def changed(path: Path, edit: Callable[[dict[str, bytes]], None]) -> bytes:
    """The zip with other files in it."""
    with zipfile.ZipFile(path) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    edit(files)
    content = io.BytesIO()
    with zipfile.ZipFile(content, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return content.getvalue()


def test_inputs_settings_and_results_come_along(tmp_path: Path) -> None:
    project = calibrated(tmp_path / "here")
    project.rename("Swifts")
    project.keep_settings({"delta": 0.002})
    path = packed(project, tmp_path / "swifts.zip")
    with zipfile.ZipFile(path) as archive:
        assert "dataset.json" in archive.namelist()
    there = unpack_project(path, path.name, tmp_path / "there")
    assert there.id != project.id
    assert there.inputs == project.inputs
    assert there.settings["delta"] == 0.002
    before, after = project.calibration, there.calibration
    assert before is not None and after is not None
    assert after.methods["3d"].cost == before.methods["3d"].cost
    assert [path.name for path in tmp_path.iterdir() if path.is_file()] == ["swifts.zip"]


def test_the_command_line_opens_it(tmp_path: Path) -> None:
    project = filled(tmp_path)
    path = packed(project, tmp_path / "project.zip")
    assert read_input(path).sha256 == read_input(FIELD).sha256
    with pytest.raises(StereocalError, match="as a zip"):
        read_input(project.database.path)
    assert main(["calibrate", str(path), "--out", str(tmp_path / "out"), "--runs", "0"]) == 0
    assert (tmp_path / "out" / "parameters_3d.json").is_file()


def test_all_that_native_code_decodes_is_tried_before_it_is_read(tmp_path: Path) -> None:
    tried: list[tuple[str, str]] = []

    def look(kind: str, path: Path, name: str) -> None:
        assert path.is_file()
        tried.append((kind, name.split("/")[0]))

    unpack_project(FULL, "full.zip", tmp_path, look)
    assert Counter(tried) == {
        ("photograph", "photographs"): 12,
        ("photograph", "boards_primary"): 7,
    }
    # A table of numbers in Parquet is one whatever it is called.
    content = changed(FULL, lambda files: files.update({"points/primary.csv": b"PAR1 and more"}))
    unpack_project(content, "full.zip", tmp_path, look)
    assert ("table", "points") in tried
