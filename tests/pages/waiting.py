"""Waiting for what happens beside the pages: for as long as it takes, and not for a while."""

from __future__ import annotations

import time
from collections.abc import Callable

from stereocal.projects.project import Project
from stereocal.ui import jobs

SLOW = 120
"""Seconds that nothing takes unless it hangs, on a busy machine either."""


def wait_until(done: Callable[[], bool]) -> None:
    end = time.monotonic() + SLOW
    while not done():
        assert time.monotonic() < end
        time.sleep(0.005)


def ended(project: Project, kind: jobs.Kind) -> jobs.Job:
    """The job of this kind that a page has begun, once it has ended, however it did."""
    job = jobs.job_of(project, kind)
    assert job is not None
    wait_until(lambda: job.state != "running")
    return job
