"""Many people calibrate on one server at once: every page answers."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page

from stereocal.formats.dataset_files import TABLE
from stereocal.projects.inputs import Slot
from stereocal.projects.project import Project
from tests.browser.conftest import LONGEST_MS, ROOT, results_shown, served

pytestmark = pytest.mark.browser
PEOPLE = int(os.environ.get("STEREOCAL_PEOPLE", "10"))
"""More than the 8 places of the cache of calibrations."""
NINETEEN = sorted((ROOT / "sample_data" / "nineteen").iterdir())
FILES: dict[Slot, str] = {
    "correspondences": TABLE,
    "primary": "primary.json",
    "secondary": "secondary.json",
}


def project_of(home: Path, number: int) -> str:
    """A project with one of the nineteen data sets, not yet calibrated; its id."""
    folder = NINETEEN[number % len(NINETEEN)]
    about = json.loads((folder / "dataset.json").read_text())
    project = Project.create(home)
    project.give(
        {slot: (name, (folder / name).read_bytes()) for slot, name in FILES.items()},
        name=f"Rig {number}",
        baseline_m=about["baseline_m"],
        target_distance_m=about["target_distance_m"],
    )
    return project.id


def cpu_s(pid: int) -> float:
    """Processor time of a process and of its children that have ended."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return sum(map(int, fields[11:15])) / os.sysconf("SC_CLK_TCK")


def opened(page: Page, url: str, project: str) -> Page:
    page.goto(f"{url}/calibrate?project={project}")
    page.locator(".st-key-run button").wait_for()
    return page


def seconds_of_cpu(browser: Browser, home: Path, at_once: bool) -> float:
    """What the server computes for all, from the press to the last answer."""
    home.mkdir()
    projects = [project_of(home, number) for number in range(PEOPLE)]
    with served(home, {"STEREOCAL_WORKERS": "2"}) as (server, url), ExitStack() as stack:
        pages: list[Page] = []
        for project in projects:
            context = browser.new_context(viewport={"width": 1400, "height": 1000})
            stack.callback(context.close)
            pages.append(opened(context.new_page(), url, project))
        before, started = cpu_s(server.pid), time.monotonic()
        for group in [pages] if at_once else [[page] for page in pages]:
            press_all(group)
        print(f"{PEOPLE} people, {at_once=}: {time.monotonic() - started:.0f} s")
        return cpu_s(server.pid) - before


def press_all(pages: Sequence[Page]) -> None:
    for page in pages:
        page.locator(".st-key-run button").click()
    for page in pages:
        results_shown(page, LONGEST_MS * PEOPLE)


def test_all_who_press_at_once_get_their_answer(browser: Browser, tmp_path: Path) -> None:
    one_by_one = seconds_of_cpu(browser, tmp_path / "one by one", at_once=False)
    together = seconds_of_cpu(browser, tmp_path / "together", at_once=True)
    print(f"{one_by_one:.1f} s of CPU one after another, {together:.1f} s together")
    assert together <= one_by_one + 60
