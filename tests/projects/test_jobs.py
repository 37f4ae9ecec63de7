"""Rows of long work: who runs it, what was interrupted, and what a search has found before."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from stereocal.projects import jobs
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.database import DiskFullError
from stereocal.projects.files import Store
from stereocal.projects.home import duplicate
from tests.projects.test_database import database as database
from tests.projects.test_project import filled


def found(database: Store) -> jobs.FoundBefore:
    return jobs.FoundBefore(database, "photographs", str)


def run_elsewhere(database: Store) -> sqlite3.Connection:
    """Have another server run the jobs, until the connection is closed: then it was killed."""
    path = database.path.parents[1] / "servers" / "another.sqlite"
    with database.transaction() as db:
        db.execute("UPDATE job SET server = ?", [path.name])
    lock = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    lock.execute("BEGIN EXCLUSIVE")
    return lock


def test_a_job_runs_once_and_leaves_nothing(database: Store) -> None:
    assert jobs.state(database, "photographs") is None and not jobs.has_interrupted(database)
    assert jobs.begin(database, "photographs")
    assert jobs.begin(database, "apply") and not jobs.has_interrupted(database)
    with closing(run_elsewhere(database)):
        assert jobs.state(database, "photographs") == "elsewhere"
        assert not jobs.begin(database, "photographs") and not jobs.has_interrupted(database)
    found(database).keep("a", "A")
    for kind in ("photographs", "apply"):
        jobs.end(database, kind)
        assert jobs.state(database, kind) is None
    assert found(database).get("a") is None


@pytest.mark.parametrize("failed", [True, False])
def test_what_an_unfinished_search_has_found_is_there_for_the_next(
    failed: bool, database: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert jobs.begin(database, "photographs")
    found(database).keep("a", "A")
    if failed:
        jobs.end(database, "photographs", failed=True)
        assert not jobs.has_interrupted(database)
    else:
        run_elsewhere(database).close()
        assert jobs.state(database, "photographs") == "interrupted"
        assert jobs.has_interrupted(database)
    assert jobs.begin(database, "photographs") and not jobs.has_interrupted(database)
    assert found(database).get("a") == "A" and found(database).get("b") is None
    monkeypatch.setattr(jobs, "SOFTWARE", "of another version")
    assert found(database).get("a") is None


def test_what_is_damaged_is_looked_for_again(database: Store) -> None:
    found(database).keep("a", "A")
    with database.transaction() as db:
        db.execute("UPDATE found SET content = ?", [b"\xff"])
    assert found(database).get("a") is None


def test_a_disk_that_fails_is_no_sign_of_a_running_server(
    database: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert jobs.begin(database, "photographs")
    run_elsewhere(database).close()
    folder = database.path.parents[1] / "servers"

    class Failing:
        Error, OperationalError = sqlite3.Error, sqlite3.OperationalError

        @staticmethod
        def connect(*_: object, **__: object) -> sqlite3.Connection:
            return sqlite3.connect(folder / "no folder" / "x")

    monkeypatch.setattr(jobs, "sqlite3", Failing)
    assert jobs.state(database, "photographs") == "interrupted"


def test_on_a_full_disk_the_job_goes_on(database: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise DiskFullError("The disk is full.")

    before = found(database)
    with monkeypatch.context() as patch:
        patch.setattr(Store, "transaction", full)
        before.keep("a", "A")
    assert before.get("a") is None


def test_jobs_are_neither_carried_nor_copied(tmp_path: Path) -> None:
    project = filled(tmp_path)
    assert jobs.begin(project.database, "photographs")
    found(project.database).keep("a", "A")
    pack_project(project, tmp_path / "packed.zip")
    opened = unpack_project(tmp_path / "packed.zip", "packed.zip", tmp_path)
    for copy in (duplicate(tmp_path, project.id), opened):
        assert jobs.state(copy.database, "photographs") is None
        assert found(copy.database).get("a") is None
