"""A server with a Dask cluster: its jobs are computed there, or say why they cannot be."""

from __future__ import annotations

import operator
from pathlib import Path

import pytest

from stereocal.projects.project import Project
from stereocal.system import executors
from stereocal.system.executors import SCHEDULER, Cluster
from stereocal.system.tasks import Task, run_tasks
from stereocal.ui import jobs
from tests.dask_cluster import QUIET
from tests.dask_cluster import scheduler as scheduler
from tests.pages.waiting import ended

pytestmark = QUIET


def begun(home: Path, found: list[object]) -> jobs.Job:
    def run(job: jobs.Job) -> bool:
        tasks = (Task(f"{number}", operator.neg, (number,)) for number in range(9))
        found.extend(value for _, value in run_tasks(tasks, job.executor, 9, job.progress))
        found.append(type(job.executor))
        return True

    project = Project.create(home)
    jobs.start(jobs.Work(project, "evaluation", ("runs",), {}, run))
    return ended(project, "evaluation")


def test_a_job_is_computed_there(
    scheduler: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SCHEDULER, scheduler)
    found: list[object] = []
    assert begun(tmp_path, found).state == "done"
    assert found == [*range(0, -9, -1), Cluster]
    # A connection that has ended is made again.
    first = jobs.workers()
    assert jobs.workers() is first
    first.shutdown()
    assert begun(tmp_path, []).state == "done"
    assert jobs.workers() is not first


def test_a_job_says_that_the_cluster_does_not_answer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(SCHEDULER, "tcp://127.0.0.1:1")
    monkeypatch.setattr(executors, "LONGEST_TO_CONNECT", "100ms")
    job = begun(tmp_path, [])
    assert job.state == "failed"
    assert "tcp://127.0.0.1:1 cannot be reached" in job.sentence
