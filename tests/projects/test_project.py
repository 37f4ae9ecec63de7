"""A project on disk: every change whole or not at all, and nothing lost."""

import os
from pathlib import Path

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.formats.correspondences_csv import TEMPLATE
from stereocal.formats.point_answers import first_answers, layout_of
from stereocal.library.calibrations import calibrate
from stereocal.projects import application
from stereocal.projects.application import ProjectApplication
from stereocal.projects.packed import NAMES
from stereocal.projects.project import Project
from stereocal.projects.server_settings import default_home
from stereocal.system.latest import forget
from tests.refused import refused

XYPTS = b"pt1_cam1_X,pt1_cam1_Y,pt1_cam2_X,pt1_cam2_Y\n1.5,2,3,4\n5,6,NaN,NaN\n7,8,9,10\n"
FIELD = Path(__file__).parents[2] / "sample_data" / "field"


TRANSPOSED = (
    (FIELD / NAMES["correspondences"])
    .read_bytes()
    .replace(b"u_", b"x_")
    .replace(b"v_", b"u_")
    .replace(b"x_", b"v_")
)
"""The sample's table with rows before columns."""


def filled(home: Path) -> Project:
    project = Project.create(home)
    files = {slot: (name, (FIELD / name).read_bytes()) for slot, name in NAMES.items()}
    project.give(files, baseline_m=4.5, target_distance_m=0.9)
    return project


def test_id_is_unguessable_and_nothing_else_opens(tmp_path: Path) -> None:
    ids = {Project.create(tmp_path).id for _ in range(20)}
    assert len(ids) == 20 and all(len(name) == 32 for name in ids)
    for bad in ("", "../..", "A" * 32, "0" * 31, "0" * 32, f"{'0' * 32}\n", f"../{'0' * 29}"):
        with refused("address", "project"):
            Project.open(tmp_path, bad)


def test_missing_parts_are_named_until_complete(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    assert len(project.inputs.missing) == 5
    project.give({"primary": ("p.json", (FIELD / "primary.json").read_bytes())}, baseline_m=4.5)
    points, camera = "the table of points", "the secondary camera's file"
    assert project.inputs.missing == [points, camera, "the distance between the targets"]
    assert project.dataset is None


def test_a_planned_length_is_missing_until_it_is_measured(tmp_path: Path) -> None:
    project = filled(tmp_path)
    project.give({}, planned=["baseline_m", "target_distance_m"])
    named = [words.partition(" as ")[0] for words in project.inputs.missing]
    assert named == ["the baseline", "the distance between the targets"]
    assert project.dataset is None
    # A baseline that is left free needs no measuring.
    project.give({}, baseline_free=True)
    assert project.inputs.needs_measuring == ["target_distance_m"]
    project.give({}, target_distance_m=0.9)
    assert project.inputs.missing == []
    project.give({}, baseline_free=False)
    assert project.inputs.missing == ["the baseline as measured (planned: 4.5 m)"]
    project.take_planned()
    assert project.inputs.missing == []


@pytest.mark.parametrize(
    ("slot", "content", "said"),
    [
        ("primary", b"", ["empty"]),
        ("correspondences", b"frame,target\n1,A\n", ["columns u_primary, v_primary"]),
        ("correspondences", TEMPLATE.replace("1012.31", "9999").encode(), ["line 2", "(9999, "]),
        ("correspondences", TRANSPOSED, ["u and v of both"]),
    ],
)
def test_bad_file_leaves_the_project_as_it_was(
    slot: str, content: bytes, said: list[str], tmp_path: Path
) -> None:
    project = filled(tmp_path)
    before = project.dataset
    with refused("bad: ", *said):
        project.give({slot: ("bad", content)})  # type: ignore[dict-item]
    with refused("baseline", "-1 m"):
        project.give({}, baseline_m=-1.0)
    after = project.dataset
    assert before is not None and after is not None and before.sha256 == after.sha256


def test_result_survives_with_settings_and_trace(tmp_path: Path) -> None:
    project = filled(tmp_path)
    dataset = project.dataset
    assert dataset is not None and project.calibration is None
    made = calibrate(dataset, CalibrationSettings(calibration_frames=20), trace=True)
    project.keep_calibration(made, project.inputs)
    back = Project.open(tmp_path, project.id).calibration
    assert back is not None
    assert back.settings == made.settings and back.dataset.sha256 == dataset.sha256
    np.testing.assert_array_equal(back.frames, made.frames)
    for method, found in made.methods.items():
        np.testing.assert_array_equal(back.methods[method].pose.R, found.pose.R)
        assert back.methods[method].cost == found.cost
    trace, kept = made.methods["2d"].trace, back.methods["2d"].trace
    assert trace is not None and kept is not None
    np.testing.assert_array_equal(trace.cost, kept.cost)
    np.testing.assert_array_equal(trace.ratio, kept.ratio)


def test_result_is_kept_with_the_inputs_it_was_made_from_not_with_later_ones(
    tmp_path: Path,
) -> None:
    project = filled(tmp_path)
    inputs, dataset = project.inputs, project.dataset
    assert dataset is not None
    made = calibrate(dataset)
    project.give({}, baseline_m=4.6)  # another tab, meanwhile
    project.keep_calibration(made, inputs)
    kept = project.calibration
    assert kept is not None and kept.dataset.baseline_m == 4.5


def test_a_result_without_a_refined_set_has_none_when_it_is_read_again(tmp_path: Path) -> None:
    project = filled(tmp_path)
    dataset = project.dataset
    assert dataset is not None
    project.keep_calibration(calibrate(dataset, refined=None), project.inputs)
    forget()  # as after a restart
    back = Project.open(tmp_path, project.id).calibration
    assert back is not None and back.refined is None


def test_home_is_a_setting(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    assert default_home() == tmp_path
    monkeypatch.delenv("STEREOCAL_HOME")
    assert default_home().name == "stereocal"
    assert os.fspath(default_home()).startswith(os.fspath(Path.home())) or "XDG" in os.environ


def test_an_answered_table_is_not_read_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    store = ProjectApplication(Project.create(tmp_path))
    store.offer_points("primary", "xypts.csv", XYPTS)
    answers = first_answers(layout_of(XYPTS, "xypts.csv"), 0, image_height=1024)
    with monkeypatch.context() as patch:
        patch.delattr(application, "PointTable")
        store.answer("primary", answers)
    points = store.points("primary")
    assert points is not None and (points.rows, points.frames) == (3, 3)
    assert store.asking("primary") is None
    assert len(store.whole_table(points.name, "xypts.csv")) == 3
