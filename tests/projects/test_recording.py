"""A recording of three cameras in a project, and its rig."""

import json
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.formats.camera_file import read_camera
from stereocal.formats.dataset_files import parse_recording
from stereocal.projects import jobs
from stereocal.projects.application import ProjectCheck
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.contents import RECORDING
from stereocal.projects.home import card_of, duplicate, find_projects
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.ui.intake import give_dataset
from stereocal.ui.page_states import page_states
from stereocal.ui.start import RIG, three_cameras


def given() -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in RIG.iterdir() if path.suffix != ".md"}


@cache
def rig_text() -> str:
    """The rig of every third frame."""
    recording = parse_recording(given(), "sample")
    return rig_file(calibrate_rig(recording.where(recording.frame % 3 == 0))).dumps()


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Project:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    return three_cameras()


def test_the_recording_is_kept(project: Project, tmp_path: Path) -> None:
    store = ProjectRecording(project)
    recording = store.read()
    assert store.is_given and recording is not None
    assert list(recording.cameras) == ["1", "2", "3"]
    assert project.inputs.name == recording.name
    assert page_states(project)["rig"].mark == "missing"
    assert card_of(project).data == "3 cameras"
    found = RigFile.loads(rig_text())
    store.keep_rig(found.dumps(), b"zip")
    assert page_states(project)["rig"].mark == "done"
    assert store.pairs == b"zip"
    assert "One rig: 0." in (said := card_of(project).result) and "worst pair" in said
    pack_project(project, tmp_path / "project.zip")
    copy = ProjectRecording(unpack_project(tmp_path / "project.zip", "zip", tmp_path / "there"))
    assert copy.digest == store.digest
    assert copy.rig is not None and copy.rig.names == found.names
    # a new recording has no rig yet
    store.give(parse_recording(given(), "again"), given())
    assert store.rig is None


def test_an_invalid_recording_changes_nothing(project: Project) -> None:
    store = ProjectRecording(project)
    before = store.digest
    with pytest.raises(StereocalError, match="dataset"):
        give_dataset(project, {"dataset.json": b"{}"}, "damaged")
    assert store.digest == before


def test_the_files_of_fisheyes_state_that_they_are(tmp_path: Path) -> None:
    """Four coefficients, of a lens that was asked about."""
    four = json.dumps({"K": np.diag([900, 900, 1]).tolist(), "image_size": [2048, 2048]})
    lens = f'{four[:-1]}, "distortion": [0.1, 0.01, 0.0, 0.0]}}'.encode()
    files = {name: lens if name.endswith(".yaml") else content for name, content in given().items()}
    project = Project.create(tmp_path)
    give_dataset(project, files, "fisheyes", lens_model="fisheye")
    stored = project.database.files(RECORDING)["camera_1.yaml"].read_bytes()
    assert read_camera(stored, "camera_1.yaml").is_fisheye


def test_other_projects_have_no_rig_page(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    assert not ProjectRecording(project).is_given and ProjectRecording(project).read() is None
    assert "rig" not in page_states(project)


def test_a_foreign_project_with_a_damaged_rig_is_rejected(project: Project, tmp_path: Path) -> None:
    found = json.loads(rig_text())
    del found["figures"]["frames"]
    ProjectRecording(project).keep_rig(json.dumps(found), b"zip")
    pack_project(project, tmp_path / "project.zip")
    with pytest.raises(StereocalError, match="damaged"):
        unpack_project(tmp_path / "project.zip", "zip", tmp_path / "there")


def test_a_pair_is_kept_in_the_project_of_its_rig(project: Project, tmp_path: Path) -> None:
    store = ProjectRecording(project)
    store.keep_rig(rig_text(), b"zip")
    pair = store.pair("1-2")
    dataset, rig = pair.dataset, store.rig
    assert dataset is not None and rig is not None
    assert (pair.id, pair.pair, project.pair) == (project.id, "1-2", None)
    assert np.allclose(dataset.primary.K, rig.cameras["1"].K)
    assert dataset.primary.uncertainty is not None
    fx = rig.standard_errors["1"]["fx"]
    assert dataset.primary.uncertainty.fx == pytest.approx(fx)
    assert page_states(pair)["calibrate"].mark == "missing"
    assert page_states(pair)["rig"].mark == "done"
    # Nothing of it shows in the project itself or in another pair.
    pair.keep_settings({"delta": 2e-3})
    pair.database.keep_result("recommended", b'["2d", "3d"]')
    pair.leave_out(int(dataset.correspondences.frames[0]))
    assert project.settings == {} and project.recommended is None
    assert store.pair("2-3").recommended is None
    assert find_projects(tmp_path) == [project.id]
    # Copied and exported with it.
    pack_project(project, tmp_path / "project.zip")
    opened = unpack_project(tmp_path / "project.zip", "zip", tmp_path / "there")
    for other in (opened, duplicate(tmp_path, project.id)):
        copy = ProjectRecording(other).pair("1-2")
        assert copy.inputs == pair.inputs and copy.settings == pair.settings
        assert copy.recommended == ("2d", "3d")
    # A new rig gives it new lenses; what was said of its frames stays.
    about = json.loads(rig_text())
    about["cameras"]["1"]["K"][0][0] += 1.0
    store.keep_rig(json.dumps(about), b"zip")
    again = store.pair("1-2")
    assert again.inputs.left_out == pair.inputs.left_out
    assert again.dataset is not None
    assert again.dataset.primary.K[0, 0] == pytest.approx(dataset.primary.K[0, 0] + 1.0)
    # Another recording has no pairs yet; what was given on Check is not of one.
    new = ProjectCheck(project).of_images
    new.rename("new")
    store.give(parse_recording(given(), "again"), given())
    assert not pair.inputs.files and new.inputs.name == "new"


def test_a_pair_is_there_whole_or_not_at_all(
    project: Project, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Killed between two writes of its first opening; then it is opened again."""

    def killed(*_: Any) -> None:
        raise KeyboardInterrupt

    store = ProjectRecording(project)
    with monkeypatch.context() as patch:
        patch.setattr(Project, "keep_settings", killed)
        with pytest.raises(KeyboardInterrupt):
            store.pair("1-2")
    assert not Project(project.database.of_pair("1-2")).inputs.files
    assert store.pair("1-2").dataset is not None


def test_jobs_are_kept_by_pair(project: Project) -> None:
    store = ProjectRecording(project)
    one, other = store.pair("1-2").database, store.pair("1-3").database
    jobs.begin(one, "calibration")
    jobs.begin(other, "calibration")
    assert not jobs.is_interrupted(project.database, "calibration")
    jobs.end(one, "calibration")
    assert not jobs.is_interrupted(one, "calibration")
    assert jobs.is_interrupted(other, "calibration")


@pytest.mark.parametrize("name", ["1-4", "1", "../1-2", "pair 1-2/"])
def test_there_is_no_such_pair(project: Project, name: str) -> None:
    with pytest.raises(StereocalError, match="There is no pair"):
        ProjectRecording(project).pair(name)
