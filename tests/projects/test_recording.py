"""A recording of three cameras in a project, and its rig."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stereocal.errors import StereocalError
from stereocal.network.calibrate import calibrate_rig
from stereocal.network.placings import rows_where
from stereocal.network.rig_file import rig_file
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.card import card_of
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.ui.page_states import page_states
from stereocal.ui.samples import RIG, three_cameras


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Project:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    return three_cameras()


def test_the_recording_is_kept(project: Project, tmp_path: Path) -> None:
    store = ProjectRecording(project)
    recording = store.read()
    assert store.is_given
    assert recording is not None
    assert list(recording.cameras) == ["1", "2", "3"]
    assert project.inputs.name == recording.name
    assert page_states(project)["rig"].mark == "missing"
    assert card_of(project).data == "3 cameras"
    found = rig_file(calibrate_rig(rows_where(recording, recording.frame % 3 == 0)))
    store.keep_rig(found.dumps(), b"zip")
    assert page_states(project)["rig"].mark == "done"
    assert store.pairs == b"zip"
    assert "One rig: 0." in card_of(project).result
    pack_project(project, tmp_path / "project.zip")
    copy = ProjectRecording(unpack_project(tmp_path / "project.zip", "zip", tmp_path / "there"))
    assert copy.digest == store.digest
    assert copy.rig is not None
    assert copy.rig.names == found.names
    # a new recording has no rig yet
    files = {path.name: path.read_bytes() for path in RIG.iterdir() if path.suffix != ".md"}
    store.give(files, "again")
    assert store.rig is None


def test_an_invalid_recording_changes_nothing(project: Project) -> None:
    store = ProjectRecording(project)
    before = store.digest
    with pytest.raises(StereocalError, match="dataset"):
        store.give({"dataset.json": b"{}"}, "damaged")
    assert store.digest == before


def test_other_projects_have_no_rig_page(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    assert not ProjectRecording(project).is_given
    assert ProjectRecording(project).read() is None
    assert "rig" not in page_states(project)


def test_a_foreign_project_with_a_damaged_rig_is_rejected(project: Project, tmp_path: Path) -> None:
    recording = ProjectRecording(project).read()
    assert recording is not None
    found = rig_file(calibrate_rig(rows_where(recording, recording.frame % 3 == 0))).to_json()
    del found["figures"]["frames"]
    ProjectRecording(project).keep_rig(json.dumps(found), b"zip")
    pack_project(project, tmp_path / "project.zip")
    with pytest.raises(StereocalError, match="damaged"):
        unpack_project(tmp_path / "project.zip", "zip", tmp_path / "there")
