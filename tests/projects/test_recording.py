"""A recording of three cameras in a project, and its rig."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.formats.camera_file import read_camera
from stereocal.formats.dataset_files import parse_recording
from stereocal.projects import jobs
from stereocal.projects.application import ProjectCheck
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.contents import RECORDING
from stereocal.projects.data import LENGTHS_OF_ALL, OF_TABLE
from stereocal.projects.home import card_of, find_projects
from stereocal.projects.project import Project
from stereocal.system.made_from import changed, digest_of
from stereocal.ui.intake import give_dataset
from stereocal.ui.page_states import page_states
from stereocal.ui.rig import run_of
from stereocal.ui.start import FIELD, RIG, three_cameras
from stereocal.workflow.made_from import parts_of
from tests.refused import refused


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
    recording = project.recording
    assert project.is_rig and recording is not None
    assert list(recording.cameras) == ["1", "2", "3"]
    assert project.inputs.name == recording.name
    assert page_states(project)["calibrate"].mark == "missing"
    assert card_of(project).data == "3 cameras"
    found = RigFile.loads(rig_text())
    run = run_of(project)
    assert run is not None
    project.keep_rig(found.dumps(), b"zip", {**run.made_from, "baseline 1-2": "7 m"})
    assert page_states(project)["calibrate"].mark == "stale"
    assert "7 m" in page_states(project)["calibrate"].words
    project.keep_rig(found.dumps(), b"zip", run.made_from)
    assert page_states(project)["calibrate"].mark == "done"
    assert project.pair_files == b"zip"
    assert "One rig: 0." in (said := card_of(project).result) and "worst pair" in said
    pack_project(project, tmp_path / "project.zip")
    copy = unpack_project(tmp_path / "project.zip", "zip", tmp_path / "there")
    assert copy.database.files(RECORDING) == project.database.files(RECORDING)
    assert page_states(copy)["calibrate"].mark == "done"
    assert copy.rig is not None and copy.rig.names == found.names
    # a new recording has no rig yet
    other = {**given(), "more.txt": b""}
    project.give_recording(parse_recording(given(), "again"), other)
    assert project.rig is None


STATED: dict[str, dict[str, Any]] = {
    "a baseline": {"baselines_m": {"1-2": 2.0}},
    "another one": {"baselines_m": {"1-3": 2.0}},
    "how well it is known": {"baselines_m": {"1-2": 2.0}, "baseline_sigma_m": 0.01},
    "no baseline": {"baseline_free": True},
    "how well the object is known": {"target_distance_sigma_m": 0.001},
    "frames left out": {"left_out": [9]},
    "targets exchanged": {"exchanged": {"2": [9]}},
}
"""What a person states of a recording of three cameras."""


def test_what_is_stated_is_in_the_recording_and_makes_a_rig_stale(project: Project) -> None:
    given, digests, recording = project.inputs, set[str](), project.recording
    assert recording is not None and 9 in recording.frame[recording.camera == 1]
    own = {name: getattr(given, name) for name in (*LENGTHS_OF_ALL, *OF_TABLE)}
    for values in ({}, *STATED.values()):
        with project.database.transaction():
            project.give({}, **own | values)
        run = run_of(project)
        assert run is not None
        digests.add(digest_of(run.made_from))
    assert len(digests) == 1 + len(STATED)


def test_each_part_of_a_recording_that_changed_is_named_alone(project: Project) -> None:
    recording = project.recording
    assert recording is not None
    held, lens = recording.object, recording.cameras["2"]
    middle = held.points.copy()
    middle[np.argsort(np.abs(held.points - held.points.mean(axis=0)).max(axis=1))[0]] *= 1.1
    points = recording.points.copy()
    points[7, 0] += 1e-9
    now = {
        "lens of camera 2": replace(
            recording,
            cameras={**recording.cameras, "2": replace(lens, K=lens.K * [[1.001], [1], [1]])},
        ),
        "shape of the object": replace(recording, object=replace(held, points=middle)),
        "distance between the targets": replace(
            recording, object=replace(held, points=held.points * 1.01)
        ),
        "uncertainty of the distance between the targets": replace(
            recording, object=replace(held, sigma_m=0.001)
        ),
        "baseline 1-3": replace(recording, baselines_m={("3", "1"): 2.0}),
        "uncertainty of the baseline": replace(recording, baseline_sigma_m=0.01),
        "points": replace(recording, points=points),
    }
    then = parts_of(recording)
    assert changed(then, parts_of(replace(recording, name="another"))) == ""
    for name, other in now.items():
        assert changed(then, parts_of(other)).partition(" (")[0] == name


def test_lengths_of_three_cameras_are_stated(project: Project) -> None:
    project.give({}, baselines_m={"2-1": 2.5}, baseline_sigma_m=0.01, target_distance_sigma_m=0.002)
    recording = project.recording
    assert recording is not None
    assert recording.baselines_m == {("2", "1"): 2.5} and recording.baseline_sigma_m == 0.01
    assert recording.object.sigma_m == 0.002
    frame = int(recording.frame[recording.camera == 1][0])
    project.exchange_targets(frame, "2")
    exchanged = project.recording
    assert exchanged is not None
    changed = exchanged.target != recording.target
    assert {*recording.frame[changed]} == {frame}
    assert {*recording.camera[changed]} == {1}


def test_two_cameras_and_three_take_the_place_of_each_other(project: Project) -> None:
    project.give({}, baselines_m={"1-2": 2.0}, left_out=[9])
    give_dataset(project, {path.name: path.read_bytes() for path in FIELD.iterdir()}, "field")
    of_two = project.dataset
    assert project.camera_count == 2 and of_two is not None
    assert project.inputs.baselines_m == {} and project.inputs.left_out == []
    project.leave_out(1)
    project.exchange_targets(2)
    project.keep_recommended("2d", "3d")
    project.give_recording(parse_recording(given(), "sample"), given())
    assert project.camera_count == 3 and project.dataset is None and not project.recommended
    assert project.inputs.left_out == [] and project.inputs.exchanged == {}
    # Corrected files of the same recording leave what was stated of its lengths.
    project.give({}, baselines_m={"1-2": 2.0}, target_distance_sigma_m=0.001)
    files = {**given(), "more.txt": b""}
    project.give_recording(parse_recording(given(), "again"), files, same_lengths=True)
    assert project.inputs.baselines_m == {"1-2": 2.0}
    assert project.inputs.target_distance_sigma_m == 0.001


def test_an_invalid_recording_changes_nothing(project: Project) -> None:
    before = project.database.files(RECORDING)
    with refused("damaged: dataset.json", "stereocal-dataset/1"):
        give_dataset(project, {"dataset.json": b"{}"}, "damaged")
    assert project.database.files(RECORDING) == before


def test_the_files_of_fisheyes_state_that_they_are(tmp_path: Path) -> None:
    """Four coefficients, of a lens that was asked about."""
    four = json.dumps({"K": np.diag([900, 900, 1]).tolist(), "image_size": [2048, 2048]})
    lens = f'{four[:-1]}, "distortion": [0.1, 0.01, 0.0, 0.0]}}'.encode()
    files = {name: lens if name.endswith(".yaml") else content for name, content in given().items()}
    project = Project.create(tmp_path)
    give_dataset(project, files, "fisheyes", lens_model="fisheye")
    stored = project.database.files(RECORDING)["camera_1.yaml"].read_bytes()
    assert read_camera(stored, "camera_1.yaml").is_fisheye


def test_a_foreign_project_with_a_damaged_rig_is_rejected(project: Project, tmp_path: Path) -> None:
    found = json.loads(rig_text())
    del found["figures"]["frames"]
    project.keep_rig(json.dumps(found), b"zip", {})
    pack_project(project, tmp_path / "project.zip")
    with refused("rig.json: ", "figures", "frames"):
        unpack_project(tmp_path / "project.zip", "zip", tmp_path / "there")


def test_a_pair_is_a_view_with_results_of_its_own(project: Project, tmp_path: Path) -> None:
    project.keep_rig(rig_text(), b"zip", {})
    pair, rig = project.of_pair("1-2"), project.rig
    dataset = pair.dataset
    assert dataset is not None and rig is not None and pair.rig_settings is not None
    assert project.dataset is None
    assert np.allclose(dataset.primary.K, rig.cameras["1"].K)
    assert dataset.primary.uncertainty is not None
    fx = rig.standard_errors["1"]["fx"]
    assert dataset.primary.uncertainty.fx == pytest.approx(fx)
    # Settings and corrections are the project's, results the pair's.
    pair.keep_settings({"delta": 2e-3})
    pair.leave_out(int(dataset.correspondences.frames[0]))
    pair.keep_recommended("2d", "3d")
    assert project.settings == {"delta": 2e-3} and project.inputs == pair.inputs
    assert project.recommended is None and project.of_pair("2-3").recommended is None
    assert find_projects(tmp_path) == [project.id]
    # A new rig gives it new lenses, and its results go; what was given on Check is of no pair.
    new = ProjectCheck(project).of_images
    new.rename("new")
    about = json.loads(rig_text())
    about["cameras"]["1"]["K"][0][0] += 1.0
    project.keep_rig(json.dumps(about), b"zip", {})
    again = pair.dataset
    assert again is not None and again.primary.K[0, 0] == pytest.approx(dataset.primary.K[0, 0] + 1)
    assert pair.recommended is None and new.inputs.name == "new"


def test_jobs_are_kept_by_pair(project: Project) -> None:
    one, other = (project.of_pair(name).results for name in ("1-2", "1-3"))
    jobs.begin(one, "calibration")
    jobs.begin(other, "calibration")
    assert not jobs.is_interrupted(project.database, "calibration")
    jobs.end(one, "calibration")
    assert not jobs.is_interrupted(one, "calibration")
    assert jobs.is_interrupted(other, "calibration")


@pytest.mark.parametrize("name", ["1-4", "1", "../1-2", "pair 1-2/"])
def test_there_is_no_such_pair(project: Project, name: str) -> None:
    with refused(f'"{name}"', "1-2 (409 frames)"):
        project.of_pair(name)
