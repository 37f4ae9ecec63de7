"""Many people calibrate on one server at once: every page answers."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from stereocal.projects.project import Project
from stereocal.workflow import calibrate
from tests.browser.conftest import LONGEST_MS, ROOT, results_shown, served
from tests.browser.work import a_project

pytestmark = pytest.mark.browser
PEOPLE = int(os.environ.get("STEREOCAL_PEOPLE", "10"))
"""More than the 8 places of the cache of calibrations."""
NINETEEN = sorted((ROOT / "sample_data" / "nineteen").iterdir())


def cpu_s(pid: int) -> float:
    """Processor time of a process and of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def opened(page: Page, url: str, project: str) -> Page:
    page.goto(f"{url}/calibrate?project={project}")
    page.locator(".st-key-run button").wait_for()
    return page


def seconds_of_cpu(browser: Browser, home: Path, people: int, at_once: bool) -> float:
    """What the server computes for all, from the press to the last answer."""
    home.mkdir()
    projects = [a_project(home, NINETEEN[k % 19], f"Rig {k}").id for k in range(people)]
    with served(home, {"STEREOCAL_WORKERS": "2"}) as (server, url), ExitStack() as stack:
        pages: list[Page] = []
        for project in projects:
            context = browser.new_context(viewport={"width": 1400, "height": 1000})
            stack.callback(context.close)
            pages.append(opened(context.new_page(), url, project))
        before, started = cpu_s(server.pid), time.monotonic()
        for group in [pages] if at_once else [[page] for page in pages]:
            press_all(group)
        print(f"{people} people, {at_once=}: {time.monotonic() - started:.0f} s")
        used = cpu_s(server.pid) - before
    found = Project.open(home, projects[-1])
    dataset, calibration = found.dataset, found.calibration
    assert dataset is not None and calibration is not None
    for method, own in calibrate(dataset).methods.items():  # to the last bit, whoever else computes
        assert calibration.methods[method].pose.angles == own.pose.angles
    return used


def press_all(pages: Sequence[Page]) -> None:
    for page in pages:
        page.locator(".st-key-run button").click()
    for page in pages:
        results_shown(page, LONGEST_MS * PEOPLE)


def test_all_who_press_at_once_get_their_answer(browser: Browser, tmp_path: Path) -> None:
    alone = seconds_of_cpu(browser, tmp_path / "alone", 2, at_once=False) / 2
    together = seconds_of_cpu(browser, tmp_path / "together", PEOPLE, at_once=True)
    print(f"{alone:.1f} s of CPU for one, {together:.1f} s for {PEOPLE} together")
    assert together <= PEOPLE * alone + 60
