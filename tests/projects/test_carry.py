"""A project as one zip: it opens elsewhere with all it had, and no zip leads out of its folder."""

from __future__ import annotations

import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import pytest

from stereocal.cli import main
from stereocal.errors import StereocalError
from stereocal.projects.archive import pack_project, read_input, unpack_project
from stereocal.projects.project import Project
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
    (project.folder / "photographs" / "thumbnails").mkdir(parents=True)
    (project.folder / "photographs" / "thumbnails" / "a.jpg").write_bytes(b"small")
    path = packed(project, tmp_path / "swifts.zip")
    with zipfile.ZipFile(path) as archive:
        assert not any("thumbnails" in name for name in archive.namelist())
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
    for source in (path, project.folder):
        dataset = read_input(source)
        assert dataset.sha256 == read_input(FIELD).sha256
    assert main(["calibrate", str(path), "--out", str(tmp_path / "out"), "--runs", "0"]) == 0
    assert (tmp_path / "out" / "parameters_3d.json").is_file()


def test_what_is_missing_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    project = Project.create(tmp_path)
    path = packed(project, tmp_path / "empty.zip")
    assert main(["calibrate", str(path), "--out", str(tmp_path / "out")]) == 2
    assert "missing: the table of points" in capsys.readouterr().err


def lead_out(files: dict[str, bytes], stored: str) -> None:
    state = json.loads(files["project.json"])
    state["inputs"]["files"]["primary"] = stored
    files["project.json"] = json.dumps(state).encode()


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda files: files.update({"../out.json": b"x"}), "no file of a project"),
        (lambda files: files.update({"/etc/out": b"x"}), "no file of a project"),
        (lambda files: files.update({"inputs/..\\out": b"x"}), "no file of a project"),
        (lambda files: files.update({".hidden": b"x"}), "no file of a project"),
        (lambda files: files.update({"a/b/c/d/e": b"x"}), "no file of a project"),
        (lambda files: files.pop("project.json"), "no stereocal project"),
        (lambda files: files.update({"project.json": b"{}"}), "another version"),
        (lambda files: files.update({"project.json": b"\xff"}), "is damaged"),
        (lambda files: lead_out(files, "../../secret"), "no file of its own"),
        (lambda files: lead_out(files, "/etc/passwd"), "no file of its own"),
        (lambda files: lead_out(files, ""), "no file of its own"),
    ],
)
def test_strange_zips_are_refused_and_leave_nothing(
    edit: Callable[[dict[str, bytes]], None], words: str, tmp_path: Path
) -> None:
    content = changed(packed(filled(tmp_path / "here"), tmp_path / "p.zip"), edit)
    with pytest.raises(StereocalError, match=words):
        unpack_project(content, "p.zip", tmp_path / "there")
    assert list((tmp_path / "there" / "projects").iterdir()) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["here", "p.zip", "there"]


def test_a_clock_without_a_battery_stands_in_no_ones_way(tmp_path: Path) -> None:
    project = calibrated(tmp_path / "here")
    os.utime(project.folder / "calibration.json", (0, 0))  # 1970; zips begin with 1980
    path = packed(project, tmp_path / "old.zip")
    assert unpack_project(path, "old.zip", tmp_path / "there").calibration is not None
