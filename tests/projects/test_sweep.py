"""What goes by itself, by clocks that jump; and what a killed server has left behind."""

from __future__ import annotations

import json
import math
import os
import time
from pathlib import Path

import pytest

from stereocal.errors import StereocalError
from stereocal.locking import FileLock, locked
from stereocal.project import Project
from stereocal.store.jobs import begin
from stereocal.store.left_over import remove_left_over
from stereocal.store.photographs import ProjectPhotographs
from stereocal.store.projects import bring_back, changed_at, recent_projects, remove
from stereocal.store.sweep import DAY_S, MARKS, sweep
from stereocal.store.unused import free_unused
from stereocal.system.photograph_files import keep_photograph

YEAR_S = 365.25 * DAY_S
NOW = time.time()
LATER = NOW + 30 * DAY_S


def at(home: Path, now: float, removed_days: float = 30, unused_days: float = 90) -> int:
    return sweep(home, removed_days, unused_days, lambda: now)


def ids(home: Path, where: str = "projects") -> set[str]:
    return {path.name for path in (home / where).iterdir() if not path.name.startswith(".")}


def test_a_jump_of_seventy_years_and_back_takes_nothing(tmp_path: Path) -> None:
    kept, removed = Project.create(tmp_path), Project.create(tmp_path)
    remove(tmp_path, removed.id)
    for hour in range(24):
        assert at(tmp_path, NOW + 70 * YEAR_S + hour * 3600) == 0
    for day in range(5):
        assert at(tmp_path, NOW + day * DAY_S) == 0
    assert ids(tmp_path) == {kept.id} and ids(tmp_path, "removed") == {removed.id}
    assert json.loads((tmp_path / MARKS).read_bytes()) == {}
    assert at(tmp_path, NOW + 70 * YEAR_S) == 0
    assert bring_back(tmp_path, removed.id).inputs.missing


def test_a_mark_from_the_future_is_worth_nothing(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    assert at(tmp_path, NOW + 70 * YEAR_S) == 0
    assert at(tmp_path, NOW + 100 * DAY_S) == 0  # too old by this clock, for the first time
    assert at(tmp_path, NOW + 100.5 * DAY_S) == 0
    assert at(tmp_path, NOW + 101 * DAY_S) == 1
    assert ids(tmp_path, "removed") == {project.id}


def test_what_is_used_again_begins_anew(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    assert at(tmp_path, NOW + 100 * DAY_S) == 0
    later = NOW + 100.5 * DAY_S
    os.utime(project.folder / "project.json", (later, later))
    assert at(tmp_path, NOW + 102 * DAY_S) == 0
    assert json.loads((tmp_path / MARKS).read_bytes()) == {}


@pytest.mark.parametrize("year", [1971.0, 2096.0])
def test_files_of_another_time_are_not_taken_at_once(year: float, tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    when = (year - 1970) * YEAR_S
    for path in project.folder.rglob("*"):
        os.utime(path, (when, when))
    assert at(tmp_path, NOW) == 0
    listed = recent_projects(tmp_path)
    assert [one.id for one in listed] == [project.id]
    assert at(tmp_path, NOW + 2 * DAY_S) == (year < 2000)
    if year < 2000:
        assert bring_back(tmp_path, project.id).id == project.id


def test_damaged_marks_are_begun_anew(tmp_path: Path) -> None:
    Project.create(tmp_path)
    (tmp_path / MARKS).write_bytes(b"[1")
    assert at(tmp_path, NOW + 100 * DAY_S) == 0
    assert at(tmp_path, NOW + 101 * DAY_S) == 1


def test_a_project_of_a_newer_version_is_not_taken(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    (project.folder / "project.json").write_text('{"format": "stereocal-project/2"}')
    for day in (100, 102, 104):
        assert at(tmp_path, NOW + day * DAY_S) == 0
    assert ids(tmp_path) == {project.id}


def test_what_is_deleted_goes_at_one_stroke(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = Project.create(tmp_path)
    remove(tmp_path, project.id)
    assert at(tmp_path, NOW + 40 * DAY_S) == 0
    monkeypatch.setattr("shutil.rmtree", lambda *_, **__: None)  # the server dies over it
    assert at(tmp_path, NOW + 42 * DAY_S) == 1
    with pytest.raises(StereocalError, match="for good"):
        bring_back(tmp_path, project.id)
    monkeypatch.undo()
    at(tmp_path, NOW + 43 * DAY_S)
    assert list((tmp_path / "removed").iterdir()) == []


def test_a_home_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    Project.create(tmp_path)
    (tmp_path / MARKS).mkdir()
    with pytest.raises(StereocalError, match="cannot be written"):
        at(tmp_path, NOW + 100 * DAY_S)
    assert len(ids(tmp_path)) == 1


def test_left_overs_go_when_nobody_holds_them(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    files = project.folder / "photographs" / "files"
    results = project.folder / "apply" / "results"
    waiting = tmp_path / "projects" / ".new.abcd1234"
    for folder in (files, results / "tmpabcd", results / "tmpheld", waiting):
        folder.mkdir(parents=True)
    gone = [
        project.folder / ".project.json.abcd_123", files / ".new-abcd1234",
        results / "tmpabcd" / "pairs.csv", waiting / "project.json",
        tmp_path / "projects" / ".x.json.abcd1234",
    ]  # fmt: skip
    stays = [
        project.folder / "project.json", project.folder / ".lock", files / "photograph.jpg",
        project.folder / ".notes", results / "tmpheld" / "pairs.csv", files / ".new-held1234",
    ]  # fmt: skip
    for path in (*gone, *stays[1:]):
        path.touch()
    held = FileLock(files / ".new-held1234")
    assert held.acquire(wait=False)
    with locked(results / "tmpheld"):
        assert remove_left_over(tmp_path, NOW - DAY_S) == 0
        assert all(path.exists() for path in (*gone, *stays))
        assert remove_left_over(tmp_path, NOW + DAY_S) == 5
    assert not any(path.exists() for path in gone)
    assert all(path.exists() for path in stays)
    held.release()
    assert remove_left_over(tmp_path, NOW + DAY_S) == 2


def test_a_project_in_use_is_left_to_the_next_sweep(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    (project.folder / ".project.json.abcd1234").touch()
    other = FileLock(project.folder / ".lock")
    assert other.acquire(wait=False)
    assert remove_left_over(tmp_path, NOW + DAY_S) == 0
    other.release()
    assert remove_left_over(tmp_path, NOW + DAY_S) == 1


def test_photographs_need_not_be_looked_at_to_date_a_project(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    for name in ("photographs/files/a.jpg", "photographs/thumbnails/b.jpg"):
        (project.folder / name).parent.mkdir(parents=True, exist_ok=True)
        (project.folder / name).touch()
        os.utime(project.folder / name, (LATER, LATER))
    assert changed_at(project.folder) < LATER
    (project.folder / "apply").mkdir()
    (project.folder / "apply" / "apply.json").touch()
    os.utime(project.folder / "apply" / "apply.json", (LATER + 600, LATER + 600))
    assert changed_at(project.folder) == LATER + 600
    assert changed_at(tmp_path / "nothing") == 0.0 and not math.isnan(changed_at(tmp_path))


def unnamed(project: Project) -> Path:
    """An old file that no list names."""
    path = project.folder / "inputs" / "0123456789abcdef0123-primary"
    path.parent.mkdir(exist_ok=True)
    path.write_bytes(b"x")
    return path


def test_what_only_a_newer_version_can_name_stays(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    path = unnamed(project)
    state = project.folder / "project.json"
    ours = state.read_text()
    state.write_text(ours.replace("stereocal-project/1", "stereocal-project/2"))
    assert free_unused(project.folder, NOW + YEAR_S) == 0
    assert path.exists()
    state.write_text(ours)
    assert free_unused(project.folder, NOW + YEAR_S) == 1


def test_a_job_that_failed_keeps_no_room(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    path = unnamed(project)
    job = begin(project.folder, "evaluation", ["runs"], {})
    assert job is not None
    assert free_unused(project.folder, NOW + YEAR_S) == 0  # it runs, and may need it
    job.fail("Something is wrong.")
    assert free_unused(project.folder, NOW + YEAR_S) == 1
    assert not path.exists()


def test_the_same_photographs_given_again_stay(tmp_path: Path) -> None:
    store = ProjectPhotographs(Project.create(tmp_path))
    found = {
        name: keep_photograph([name.encode()], name, store.files)
        for name in ("left1.png", "right1.png")
    }
    store.add(found)
    rest = {"right1.png": found["right1.png"]}
    for kept in (found, found, rest, {}):
        store.give({}, kept)
        assert store.photographs == kept
        assert {path for path in found.values() if path.exists()} == set(kept.values())


def test_what_was_brought_back_is_not_too_old(tmp_path: Path) -> None:
    project = Project.create(tmp_path)
    os.utime(project.folder / "project.json", (NOW - YEAR_S, NOW - YEAR_S))
    remove(tmp_path, project.id)
    bring_back(tmp_path, project.id)
    assert changed_at(project.folder) > NOW - DAY_S
