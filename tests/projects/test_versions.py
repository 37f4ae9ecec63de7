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
from stereocal.projects.calibration_files import pack_calibration, unpack_calibration
from stereocal.projects.database import VERSION, Database
from stereocal.projects.jobs import is_interrupted
from stereocal.projects.project import Project
from tests import known_rig

STORED = Path(__file__).parent / "version_1.sqlite"
"""Of version 1.0: a data set, a setting, a calibration, a validation of 3 runs, and a job."""


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
    for version, message in ((VERSION + 1, "newer version"), (0, "not a project")):
        with closing(sqlite3.connect(old)) as db:
            db.execute(f"PRAGMA user_version = {version}")
        with pytest.raises(StereocalError, match=message), Database(old).reading():
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
