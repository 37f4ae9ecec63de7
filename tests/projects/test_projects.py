"""The list of projects: copied, removed, brought back, swept; nothing lost on the way."""

import os
import stat
import time
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest

from stereocal.errors import StereocalError
from stereocal.fit.results import Calibration
from stereocal.library.calibrations import calibrate
from stereocal.projects.home import (
    bring_back,
    duplicate,
    find_projects,
    recent_projects,
    remove,
    sweep,
)
from stereocal.projects.project import Project
from tests.projects.test_project import filled
from tests.refused import refused


def aged(path: Path, days: float) -> None:
    """As if it had not been touched for so long."""
    when = time.time() - days * 86_400
    os.utime(path, (when, when))


@cache
def result() -> Calibration:
    """Of the data of every `filled` project."""
    with TemporaryDirectory() as folder:
        dataset = filled(Path(folder)).dataset
    assert dataset is not None
    return calibrate(dataset)


def calibrated(home: Path) -> Project:
    project = filled(home)
    project.keep_calibration(result(), project.inputs)
    return project


def test_list_has_the_newest_first(tmp_path: Path) -> None:
    assert recent_projects(tmp_path) == []
    old, new = filled(tmp_path), filled(tmp_path)
    old.rename("Swifts <b>")
    aged(old.database.path, 2)
    found = recent_projects(tmp_path)
    assert [listed.id for listed in found] == [new.id, old.id]
    assert found[1].title == "Swifts <b>"
    assert found[1].changed == pytest.approx(time.time() - 2 * 86_400, abs=60)
    assert find_projects(tmp_path) == [new.id, old.id]
    assert find_projects(tmp_path, " sWIFTS") == [old.id]
    old.rename("Bats")
    assert find_projects(tmp_path, "swifts") == []


def test_damaged_and_strange_files_do_not_stop_the_list(tmp_path: Path) -> None:
    good, damaged, newer = filled(tmp_path), filled(tmp_path), filled(tmp_path)
    damaged.database.path.write_bytes(b"{" * 5000)
    with newer.database.transaction() as db:
        db.execute("PRAGMA user_version = 9")
    (tmp_path / "projects" / "notes.sqlite").write_text("a file")
    aged(good.database.path, 1)
    found = recent_projects(tmp_path)
    assert {one.id: (one.damaged, bool(one.unreadable)) for one in found} == {
        good.id: (False, False),
        damaged.id: (True, False),
        newer.id: (False, True),
    }
    assert found[-1].id == good.id
    with refused("format 9"):
        Project.open(tmp_path, newer.id)


def test_a_copy_has_everything_and_its_own_life(tmp_path: Path) -> None:
    project = calibrated(tmp_path)
    project.rename("Field")
    copy = duplicate(tmp_path, project.id)
    assert copy.id != project.id
    assert copy.inputs.name == "Field (copy)"
    kept, own = project.calibration, copy.calibration
    assert kept is not None and own is not None
    assert own.methods["2d"].cost == kept.methods["2d"].cost
    copy.give({}, baseline_m=3.0)
    assert project.inputs.baseline_m == 4.5
    remove(tmp_path, project.id)
    assert sweep(tmp_path, removed_days=-1) == 1
    assert not project.database.path.exists()
    assert copy.dataset is not None
    assert not list((tmp_path / "projects").glob(".new*"))


def test_removed_projects_come_back_whole(tmp_path: Path) -> None:
    project = calibrated(tmp_path)
    remove(tmp_path, project.id)
    assert recent_projects(tmp_path) == []
    with refused("address", "removed"):
        Project.open(tmp_path, project.id)
    with pytest.raises(StereocalError):
        remove(tmp_path, project.id)
    back = bring_back(tmp_path, project.id)
    assert back.calibration is not None
    with refused("brought back", "removed"):
        bring_back(tmp_path, project.id)
    with refused("brought back", "removed"):
        bring_back(tmp_path, "../projects/" + project.id)


def test_sweep_takes_what_is_old_and_nothing_else(tmp_path: Path) -> None:
    old, new, removed = filled(tmp_path), filled(tmp_path), filled(tmp_path)
    aged(old.database.path, 41)
    remove(tmp_path, removed.id)
    assert sweep(tmp_path, removed_days=30) == 0
    assert sweep(tmp_path, removed_days=30, unused_days=39) == 1
    assert [listed.id for listed in recent_projects(tmp_path)] == [new.id]
    assert bring_back(tmp_path, old.id).dataset is not None
    assert sweep(tmp_path, removed_days=30, unused_days=39) == 0
    aged(removed.database.marker, 32)
    assert sweep(tmp_path, removed_days=30) == 1
    with refused("brought back", "removed"):
        bring_back(tmp_path, removed.id)


def test_nobody_else_on_the_computer_may_look_in(tmp_path: Path) -> None:
    filled(tmp_path)
    assert stat.S_IMODE((tmp_path / "projects").stat().st_mode) == 0o700
