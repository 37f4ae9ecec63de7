"""Records of long work: who runs it, what was interrupted, and going on after a kill."""

from __future__ import annotations

import json
import random
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from stereocal.errors import StereocalError
from stereocal.formats.evaluation_files import unpack_evaluation
from stereocal.projects import jobs
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.home import bring_back, duplicate, remove
from tests.projects.test_parts import same_runs
from tests.projects.test_project import filled

WORK = {"datasets": ["a"], "settings": {"runs": 3}}
STAGES = ("runs", "rest")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "project.json").write_text("{}")
    return tmp_path


def begun(folder: Path, work: dict[str, object] | None = None) -> jobs.KeptJob:
    job = jobs.begin(folder, "evaluation", STAGES, WORK if work is None else work)
    assert job is not None
    return job


def keep(job: jobs.KeptJob, *keys: str) -> None:
    parts = job.parts("runs", str.encode, bytes.decode)
    for key in keys:
        parts.keep(key, key)


def kept(job: jobs.KeptJob, key: str) -> str | None:
    return job.parts("runs", str.encode, bytes.decode).get(key)


def crash(job: jobs.KeptJob) -> None:
    """As when the process ends: the lock is let go of, and nothing is said."""
    job._lock.release()


def state(folder: Path) -> str | None:
    found = jobs.find(folder, "evaluation")
    return found and found[0]


def test_a_job_runs_once_and_leaves_nothing(folder: Path) -> None:
    assert state(folder) is None and jobs.interrupted(folder) == []
    job = begun(folder)
    assert state(folder) == "running" and jobs.interrupted(folder) == []
    assert jobs.begin(folder, "evaluation", STAGES, WORK) is None
    other = jobs.begin(folder, "apply", STAGES, WORK)
    assert other is not None
    keep(job, "a")
    jobs.discard(folder, "evaluation")  # not of one that runs
    assert state(folder) == "running"
    job.end()
    other.end()
    assert state(folder) is None
    assert {path.name for path in (folder / "jobs" / "evaluation").iterdir()} == {"lock"}


def test_an_interrupted_job_says_how_far_it_was_and_goes_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "EVERY_S", 0.0)
    job = begun(folder)
    keep(job, "a", "b")
    assert job.progress(1, 340, 500)
    crash(job)
    found = jobs.find(folder, "evaluation")
    assert found is not None and found[0] == "interrupted"
    record = found[1]
    assert (record.at, record.done, record.total, record.stages) == (1, 340, 500, STAGES)
    assert record.work == WORK and record.digest == jobs.digest_of("evaluation", WORK)
    assert jobs.interrupted(folder) == [record]
    again = begun(folder)
    assert kept(again, "b") == "b"
    again.end()


def test_progress_is_written_at_most_once_a_second(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job = begun(folder)
    written = []
    with monkeypatch.context() as patch:
        now = 100.0
        patch.setattr("stereocal.projects.jobs.time.monotonic", lambda: now)
        for done in range(12):
            job.progress(0, done, 1000)
            written.append(json.loads((job.folder / "progress.json").read_bytes())["done"])
            now += 0.25
    assert written == [0] * 4 + [4] * 4 + [8] * 4
    crash(job)
    # What is told last is written with the failure.
    again = begun(folder)
    again.progress(0, 1, 2)
    again.progress(0, 2, 2)
    again.fail("Why.")
    found = jobs.find(folder, "evaluation")
    assert found is not None and found[1].done == 2


def test_parts_of_other_work_are_removed(folder: Path) -> None:
    job = begun(folder)
    keep(job, "a")
    crash(job)
    other = begun(folder, {**WORK, "settings": {"runs": 4}})
    assert kept(other, "a") is None
    crash(other)
    again = begun(folder)
    assert kept(again, "a") is None
    again.end()


def test_other_software_is_other_work(monkeypatch: pytest.MonkeyPatch) -> None:
    before = jobs.digest_of("evaluation", WORK)
    assert before != jobs.digest_of("apply", WORK)
    monkeypatch.setattr("stereocal.__version__", "another")
    assert before != jobs.digest_of("evaluation", WORK)


def test_a_failed_job_keeps_its_sentence_and_parts_until_the_next(folder: Path) -> None:
    job = begun(folder)
    keep(job, "a")
    job.fail("The disk is full.")
    found = jobs.find(folder, "evaluation")
    assert found is not None and (found[0], found[1].sentence) == ("failed", "The disk is full.")
    assert jobs.interrupted(folder) == []
    again = begun(folder)
    assert state(folder) == "running" and kept(again, "a") == "a"
    again.end()


def test_discard_forgets_everything(folder: Path) -> None:
    job = begun(folder)
    keep(job, "a")
    crash(job)
    jobs.discard(folder, "evaluation")
    assert state(folder) is None
    again = begun(folder)
    assert kept(again, "a") is None
    again.end()
    jobs.discard(folder, "apply")  # which never was


def test_another_server_can_ask_for_a_stop(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jobs, "EVERY_S", 0.0)
    job = begun(folder)
    assert job.progress(0, 1, 10)
    jobs.ask_to_stop(folder, "evaluation")
    assert not job.progress(0, 2, 10)
    job.end()
    again = begun(folder)
    assert again.progress(0, 1, 10)
    again.end()


def test_a_removed_project_stops_its_job_and_can_go_on_when_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(jobs, "EVERY_S", 0.0)
    project = filled(tmp_path)
    job = begun(project.folder)
    keep(job, "a")
    assert job.progress(0, 1, 10)
    remove(tmp_path, project.id)
    assert not job.progress(0, 2, 10)
    job.fail("It was removed.")
    assert not project.folder.exists()
    bring_back(tmp_path, project.id)
    assert state(project.folder) == "interrupted"
    again = begun(project.folder)
    assert kept(again, "a") == "a"
    again.end()


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"format": "stereocal-job/1"}', b"\xff"])
def test_a_damaged_record_is_none(folder: Path, content: bytes) -> None:
    job = begun(folder)
    crash(job)
    (folder / "jobs" / "evaluation" / "job.json").write_bytes(content)
    assert state(folder) is None
    begun(folder).end()


def test_a_folder_that_cannot_be_written_to_is_said(tmp_path: Path) -> None:
    (tmp_path / "jobs").write_text("a file in the way")
    with pytest.raises(StereocalError, match="cannot be written to"):
        begun(tmp_path)


def test_jobs_are_neither_carried_nor_copied(tmp_path: Path) -> None:
    project = filled(tmp_path)
    job = begun(project.folder)
    keep(job, "a")
    crash(job)
    copy = duplicate(tmp_path, project.id)
    assert not (copy.folder / "jobs").exists()
    pack_project(project, tmp_path / "packed.zip")
    opened = unpack_project(tmp_path / "packed.zip", "packed.zip", tmp_path)
    assert not (opened.folder / "jobs").exists()
    assert state(project.folder) == "interrupted"


def test_jobs_of_a_strangers_zip_are_refused(tmp_path: Path) -> None:
    project = filled(tmp_path)
    pack_project(project, tmp_path / "packed.zip")
    with zipfile.ZipFile(tmp_path / "packed.zip", "a") as archive:
        archive.writestr("jobs/evaluation/job.json", json.dumps({"format": "stereocal-job/1"}))
    with pytest.raises(StereocalError, match="no file of a project"):
        unpack_project(tmp_path / "packed.zip", "packed.zip", tmp_path)


CHILD = """
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from stereocal.evaluation.evaluate import EvaluationSettings, evaluate
from stereocal.formats.evaluation_files import Evaluation, pack_runs, unpack_runs
from stereocal.projects.project import Project
from stereocal.refined.unknowns import RefineSettings
from stereocal.projects import jobs

project = Project(Path(sys.argv[1]))
dataset = project.dataset
settings = EvaluationSettings(runs=300, refined=RefineSettings())
work = {"dataset": dataset.sha256, "settings": settings.to_json()}
job = jobs.begin(project.folder, "evaluation", ("runs",), work)
parts = job.parts("runs", pack_runs, unpack_runs)
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


def child(folder: Path, most: int = 1000) -> subprocess.Popen[str]:
    """A process that validates, and stops after `most` runs until it is killed."""
    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(folder), str(most)], stdout=subprocess.PIPE, text=True
    )


def line(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    return process.stdout.readline().strip()


def size_of_parts(project: Path) -> int:
    return sum(path.stat().st_size for path in (project / "jobs").glob("*/*/runs"))


def test_killed_at_random_moments_it_ends_with_the_same_result(tmp_path: Path) -> None:
    """Three kills with SIGKILL while it computes, and another process goes on each time."""
    rng = random.Random(7)
    whole, project = filled(tmp_path), filled(tmp_path)
    with child(whole.folder) as process:
        assert line(process) == "begun 0"
        assert line(process) == "ended"
    before = 0
    for most in (100, 200, 295):
        size = size_of_parts(project.folder)
        with child(project.folder, most) as process:
            said, there = line(process).split()
            assert said == "begun" and int(there) >= before
            before = int(there)
            assert state(project.folder) == "running"
            assert jobs.begin(project.folder, "evaluation", STAGES, WORK) is None
            while size_of_parts(project.folder) == size:
                time.sleep(0.001)
            time.sleep(rng.uniform(0.0, 0.3))
            process.kill()
        assert state(project.folder) == "interrupted"
        assert project.evaluation is None
    with child(project.folder) as process:
        said, there = line(process).split()
        assert 3 <= int(there) <= 60
        assert line(process) == "ended"
    first, second_ = (
        unpack_evaluation((one.folder / "evaluation.npz").read_bytes()) for one in (whole, project)
    )
    assert same_runs(list(first.runs[0]), list(second_.runs[0]))
    assert first.settings == second_.settings
