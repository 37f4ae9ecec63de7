"""Records of long work: who runs it, what was interrupted, and going on after a kill."""

import random
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from stereocal.evaluation.evaluate import evaluate_runs
from stereocal.projects import jobs
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.database import DiskFullError
from stereocal.projects.files import Store
from stereocal.projects.home import bring_back, duplicate, remove
from stereocal.projects.project import Project
from tests.projects.test_checkpoints import bits
from tests.projects.test_project import filled

WORK = {"datasets": ["a"], "settings": {"runs": 3}}
STAGES = ("runs", "rest")


@pytest.fixture
def database(tmp_path: Path) -> Store:
    return Project.create(tmp_path).database


def begun(database: Store, work: dict[str, object] | None = None) -> jobs.RunningJob:
    job = jobs.begin(database, "evaluation", STAGES, WORK if work is None else work)
    assert job is not None
    return job


def keep(job: jobs.RunningJob, *keys: str) -> None:
    parts = job.checkpoints("runs", str.encode, bytes.decode)
    for key in keys:
        parts.keep(key, key)
    job.write()


def kept(job: jobs.RunningJob, key: str) -> str | None:
    return job.checkpoints("runs", str.encode, bytes.decode).get(key)


def state(database: Store) -> str | None:
    found = jobs.find(database, "evaluation")
    return found and found[0]


def test_a_job_runs_once_and_leaves_nothing(database: Store) -> None:
    assert state(database) is None and jobs.interrupted(database) == []
    job = begun(database)
    assert state(database) == "running" and jobs.interrupted(database) == []
    assert jobs.begin(database, "evaluation", STAGES, WORK) is None
    other = jobs.begin(database, "apply", STAGES, WORK)
    assert other is not None
    keep(job, "a")
    jobs.discard(database, "evaluation")  # not of one that runs
    assert state(database) == "running"
    job.end()
    other.end()
    assert state(database) is None
    assert database.rows("SELECT count(*) FROM finished") == [(0,)]


def test_an_interrupted_job_says_how_far_it_was_and_goes_on(
    database: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "WRITE_EVERY_S", 0.0)
    job = begun(database)
    keep(job, "a", "b")
    assert job.progress(1, 340, 500)
    job.leave()  # as when the process ends: nothing is said
    assert state(database) == "interrupted"
    (record,) = jobs.interrupted(database)
    assert (record.at, record.done, record.total, record.stages) == (1, 340, 500, STAGES)
    assert record.digest == jobs.digest_of("evaluation", WORK)
    again = begun(database)
    assert kept(again, "b") == "b"
    again.end()


def test_a_disk_that_fails_is_no_sign_of_a_running_server(
    database: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun(database)
    folder = database.path.parents[1] / "servers"
    (folder / "killed.sqlite").touch()
    with database.transaction() as db:
        db.execute("UPDATE job SET server = 'killed.sqlite'")

    class Failing:
        Error, OperationalError = sqlite3.Error, sqlite3.OperationalError

        @staticmethod
        def connect(*_: object, **__: object) -> sqlite3.Connection:
            return sqlite3.connect(folder / "no folder" / "x")

    monkeypatch.setattr(jobs, "sqlite3", Failing)
    assert state(database) == "interrupted"


def test_a_failed_job_keeps_its_sentence_and_parts_until_the_next(database: Store) -> None:
    job = begun(database)
    keep(job, "a")
    job.fail("The disk is full.")
    found = jobs.find(database, "evaluation")
    assert found is not None and (found[0], found[1].sentence) == ("failed", "The disk is full.")
    assert jobs.interrupted(database) == []
    again = begun(database)
    assert state(database) == "running" and kept(again, "a") == "a"
    again.end()


def test_another_server_can_ask_for_a_stop(
    database: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "WRITE_EVERY_S", 0.0)
    job = begun(database)
    assert job.progress(0, 1, 10)
    jobs.ask_to_stop(database, "evaluation")
    assert not job.progress(0, 2, 10)
    job.end()
    again = begun(database)
    assert again.progress(0, 1, 10)
    again.end()


def test_a_removed_project_stops_its_job_and_can_go_on_when_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "WRITE_EVERY_S", 0.0)
    project = filled(tmp_path)
    job = begun(project.database)
    keep(job, "a")
    assert job.progress(0, 1, 10)
    remove(tmp_path, project.id)
    assert not job.progress(0, 2, 10)
    job.fail("It was removed.")
    bring_back(tmp_path, project.id)
    assert state(project.database) == "interrupted"
    again = begun(project.database)
    assert kept(again, "a") == "a"
    again.end()


def test_on_a_full_disk_the_job_goes_on(database: Store, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object, **__: object) -> None:
        raise DiskFullError("The disk is full.")

    job = begun(database)
    with monkeypatch.context() as patch:
        patch.setattr(Store, "transaction", full)
        keep(job, "a")
        assert job.progress(0, 1, 2)
    assert kept(job, "a") is None
    job.end()


def test_jobs_are_neither_carried_nor_copied(tmp_path: Path) -> None:
    project = filled(tmp_path)
    job = begun(project.database)
    keep(job, "a")
    job.leave()
    copy = duplicate(tmp_path, project.id)
    assert jobs.find(copy.database, "evaluation") is None
    pack_project(project, tmp_path / "packed.zip")
    opened = unpack_project(tmp_path / "packed.zip", "packed.zip", tmp_path)
    assert jobs.find(opened.database, "evaluation") is None
    assert state(project.database) == "interrupted"


CHILD = """
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.formats.evaluation_files import Evaluation, pack_runs, unpack_runs
from stereocal.projects.files import Store
from stereocal.projects.project import Project
from stereocal.refined.unknowns import RefineSettings
from stereocal.projects import jobs

project = Project(Store(Path(sys.argv[1])))
dataset = project.dataset
settings = EvaluationSettings(runs=int(sys.argv[3]), refined=RefineSettings())
work = {"dataset": dataset.sha256, "settings": settings.to_json()}
job = jobs.begin(project.database, "evaluation", ("runs",), work)
parts = job.checkpoints("runs", pack_runs, unpack_runs)
print("begun", len(parts), flush=True)

def progress(done, total):
    job.progress(0, done, total)
    if done >= int(sys.argv[2]):
        time.sleep(60)  # it is killed before

with ThreadPoolExecutor(2) as executor:
    runs = evaluate([dataset], settings, executor, progress, None, 5, parts)
project.keep_evaluation(Evaluation(runs, settings, [dataset.name], [dataset.sha256]))
job.end()
print("ended", flush=True)
"""


def parts_of(database: Store) -> int:
    return int(database.rows("SELECT count(*) FROM finished")[0][0])


@pytest.mark.soak
@pytest.mark.parametrize(("runs", "kills"), [(40, [20]), (300, [100, 200, 295])])
def test_killed_at_random_moments_it_ends_with_the_same_result(
    runs: int, kills: list[int], tmp_path: Path
) -> None:
    """Killed with SIGKILL while it computes, and another process goes on each time."""
    rng = random.Random(7)
    project, before = filled(tmp_path), 0
    command = [sys.executable, "-c", CHILD, str(project.database.path)]
    for most in [*kills, None]:
        size = parts_of(project.database)
        arguments = [str(most or 1000), str(runs)]
        with subprocess.Popen([*command, *arguments], stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            said, there = process.stdout.readline().split()
            assert said == "begun" and before <= int(there) <= runs // 5
            before = int(there)
            if most is None:
                assert before >= len(kills)
                assert process.stdout.readline().strip() == "ended"
                break
            assert state(project.database) == "running"
            assert jobs.begin(project.database, "evaluation", STAGES, WORK) is None
            while parts_of(project.database) == size:
                time.sleep(0.001)
            time.sleep(rng.uniform(0.0, 0.3))
            process.kill()
        assert state(project.database) == "interrupted"
        assert project.evaluation is None
    found, dataset = project.evaluation, project.dataset
    assert found is not None and dataset is not None and found.settings.runs == runs
    whole = evaluate_runs(dataset, found.settings, 0, range(runs))
    assert bits(list(found.runs[0])) == bits(whole)
