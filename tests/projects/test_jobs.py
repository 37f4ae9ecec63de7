"""Rows of long work: who runs it, what was interrupted, and what a search has found before."""

import sqlite3
import subprocess
import sys
from contextlib import closing
from pathlib import Path

import pytest

from stereocal.projects import jobs
from stereocal.projects.database import DiskFullError
from stereocal.projects.files import Store
from stereocal.projects.one_server import LOCK, LOCK_BEFORE, take_projects
from tests.projects.test_database import database as database
from tests.refused import refused


def found(database: Store) -> jobs.FoundBefore:
    return jobs.FoundBefore(database, "photographs", str)


def killed(database: Store) -> None:
    """Have the server that ran the jobs have ended."""
    with database.transaction() as db:
        db.execute("UPDATE job SET server = 'another'")


def test_a_job_runs_once_and_leaves_nothing(database: Store) -> None:
    assert not jobs.is_interrupted(database, "photographs")
    for kind in ("photographs", "apply"):
        jobs.begin(database, kind)
    assert not jobs.has_interrupted(database)
    found(database).keep("a", "A")
    for kind in ("photographs", "apply"):
        jobs.end(database, kind)
        assert not jobs.is_interrupted(database, kind)
    assert found(database).get("a") is None


@pytest.mark.parametrize("failed", [True, False])
def test_what_an_unfinished_search_has_found_is_there_for_the_next(
    failed: bool, database: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    jobs.begin(database, "photographs")
    found(database).keep("a", "A")
    if failed:
        jobs.end(database, "photographs", keeps=True)
        assert not jobs.has_interrupted(database)
    else:
        killed(database)
        assert jobs.is_interrupted(database, "photographs")
        assert jobs.has_interrupted(database)
    jobs.begin(database, "photographs")
    assert not jobs.has_interrupted(database)
    assert found(database).get("a") == "A" and found(database).get("b") is None
    monkeypatch.setattr(jobs, "SOFTWARE", "of another version")
    assert found(database).get("a") is None


def test_what_is_damaged_is_looked_for_again(database: Store) -> None:
    found(database).keep("a", "A")
    with database.transaction() as db:
        db.execute("UPDATE found SET content = ?", [b"\xff"])
    assert found(database).get("a") is None


SERVER = """
import sys
from pathlib import Path
from stereocal.projects.one_server import take_projects

take_projects(Path(sys.argv[1]))
print("taken", flush=True)
sys.stdin.read()
"""


def test_a_second_server_of_the_same_projects_is_refused(tmp_path: Path) -> None:
    """Until the first has ended, also by a kill; other projects have another server."""
    first = [sys.executable, "-c", SERVER, str(tmp_path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(first, text=True, stdin=pipe, stdout=pipe) as process:
        assert process.stdout is not None and process.stdout.readline() == "taken\n"
        with refused(tmp_path):
            take_projects(tmp_path)
        take_projects(tmp_path / "others")
        process.kill()
    take_projects(tmp_path)
    take_projects(tmp_path)  # it is this one


def test_a_folder_that_cannot_be_locked_has_a_server_all_the_same(tmp_path: Path) -> None:
    (tmp_path / LOCK).mkdir()
    take_projects(tmp_path)


def test_a_server_of_an_earlier_version_is_seen_and_its_lock_is_removed(tmp_path: Path) -> None:
    path = tmp_path / LOCK_BEFORE
    with closing(sqlite3.connect(path, isolation_level=None)) as before:
        before.execute("BEGIN EXCLUSIVE")
        with refused(tmp_path):
            take_projects(tmp_path)
        assert path.exists()
    take_projects(tmp_path)
    assert not path.exists() and (tmp_path / LOCK).exists()


def test_on_a_full_disk_the_job_goes_on(database: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise DiskFullError("The disk is full.")

    before = found(database)
    with monkeypatch.context() as patch:
        patch.setattr(Store, "transaction", full)
        before.keep("a", "A")
    assert before.get("a") is None
