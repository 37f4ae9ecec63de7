"""Projects stored by earlier versions are brought up to date, in one transaction."""

import json
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.library.calibrations import calibrate
from stereocal.projects import database as database_module
from stereocal.projects.application import ProjectApplication, ProjectCheck, slot_of
from stereocal.projects.archive import unpack_project
from stereocal.projects.calibration_files import pack_calibration, unpack_calibration
from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.database import VERSION, Database
from stereocal.projects.jobs import is_interrupted
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.refused import refused
from tests.rigs import known_rig

STORED = Path(__file__).parent / "version_1.sqlite"
"""Of version 1.0: a data set, a setting, a calibration, a validation of 3 runs, and a job."""


PAIRS = STORED.with_stem("version_3")
"""Of version 3, and its zip: three cameras, of which two pairs were projects, each with a
frame left out, one exchanged, settings, points, clicks and photographs."""


@pytest.fixture
def old(tmp_path: Path) -> Path:
    (tmp_path / "projects").mkdir()
    return Path(shutil.copy(STORED, tmp_path / "projects" / f"{'0' * 32}.sqlite"))


def version_of(path: Path) -> int:
    with closing(sqlite3.connect(path)) as db:
        return int(db.execute("PRAGMA user_version").fetchone()[0])


def test_a_stored_project_of_an_earlier_version_is_brought_up_to_date(old: Path) -> None:
    assert version_of(old) < VERSION
    project = Project.open(old.parents[1], old.stem)
    calibration, evaluation = project.calibration, project.calibration_evaluation
    assert version_of(old) == VERSION
    assert project.settings == {"delta": 0.002} and project.recommended == ("2d", "3d")
    assert calibration is not None and evaluation is not None
    assert calibration.refined is not None  # which version 1.0 did not store
    assert abs(calibration.methods["2d"].pose.angles.yaw - 0.24790911) < 1e-8
    assert len(evaluation.runs[0]) == 3
    assert is_interrupted(project.database, "calibration")


@pytest.mark.parametrize("suffix", [".sqlite", ".zip"])
def test_what_was_given_to_pairs_of_before_is_the_projects(suffix: str, tmp_path: Path) -> None:
    if suffix == ".zip":
        project = unpack_project(PAIRS.with_suffix(suffix), "old.zip", tmp_path)
    else:
        (tmp_path / "projects").mkdir()
        shutil.copy(PAIRS, tmp_path / "projects" / f"{'0' * 32}.sqlite")
        project = Project.open(tmp_path, "0" * 32)
    recording, inputs, apply = project.recording, project.inputs, ProjectApplication(project)
    assert recording is not None and [*recording.cameras] == ["c1", "c2", "c3"]
    # Corrections of both pairs; targets were exchanged in the second camera of each.
    assert inputs.left_out == [1, 2]
    assert inputs.exchanged == {"c2": [0], "c3": [0]}
    # The project's own settings first, then those of the pairs in turn.
    assert project.settings == {"delta": 0.002, "acceptance": 0.3}
    labels = {camera: apply.points(slot_of(camera)) for camera in recording.cameras}
    named = {camera: points and points.label for camera, points in labels.items()}
    assert named == {"c1": "p0.csv", "c2": "s0.csv", "c3": "s1.csv"}
    clicked = {click.camera for click in ProjectClicks(project).clicks.every.values()}
    assert clicked == {"c1", "c2", "c3"}
    for page in (ProjectClicks(project).of_pictures, ProjectCheck(project).of_images):
        names = ProjectPhotographs(page).photographs
        assert {*names} == {"c1/1.jpg", "c2/1.jpg", "c3/1.jpg"}
    # Results are made again.
    assert project.of_pair("c1-c2").recommended is None
    parts = project.database.rows("SELECT part FROM value UNION SELECT part FROM named")
    assert not [part for (part,) in parts if part.startswith(("pair c1", "pair c2"))]


def test_what_fails_halfway_leaves_the_earlier_version(
    old: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, second = database_module.MIGRATIONS[1]
    monkeypatch.setitem(database_module.MIGRATIONS, 1, (first, second, "SELECT * FROM nowhere"))
    with pytest.raises(StereocalError):
        Project.open(old.parents[1], old.stem)
    assert version_of(old) == 1
    monkeypatch.undo()
    assert Project.open(old.parents[1], old.stem).calibration is not None


def test_another_version_is_named(old: Path) -> None:
    for version, said in ((VERSION + 1, f"format {VERSION + 1}"), (0, "project of stereocal")):
        with closing(sqlite3.connect(old)) as db:
            db.execute(f"PRAGMA user_version = {version}")
        with refused(said), Database(old).reading():
            pass


def test_a_refined_set_of_other_unknowns_is_computed_again() -> None:
    """Of 25, with the five angles; their covariance is of no use with those of now."""
    data = known_rig.dataset(12, 0.2)
    found = calibrate(data)
    stored = json.loads(pack_calibration(found, {}))
    stored["refined"]["information"] = np.zeros((25, 25)).tolist()
    stored["refined"]["settings"]["rest"] = None
    again = unpack_calibration(json.dumps(stored).encode(), lambda _: data).refined
    assert found.refined is not None and again is not None
    assert pytest.approx(found.refined.pose.T, rel=1e-6) == again.pose.T
    assert again.covariance == pytest.approx(found.refined.covariance, rel=1e-3, abs=1e-12)
