"""A server that is killed while somebody works: what a page has acknowledged is there.

STEREOCAL_KILLS says how often each activity is killed.
"""

import os
import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Error, FilePayload, Page, expect

from stereocal.projects.home import recent_projects
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.bar_photographs import bar_set
from tests.browser.conftest import LONGEST_MS, ROOT, served, settle
from tests.browser.work import a_project

pytestmark = pytest.mark.browser
KILLS = int(os.environ.get("STEREOCAL_KILLS", "1"))
FIELD = ROOT / "sample_data" / "field"
Step = tuple[object, Callable[[], None]]
"""What the project holds once an act is acknowledged, and the act, which ends with that."""


def tables(page: Page) -> Iterator[Step]:
    content = (FIELD / "correspondences.csv").read_bytes()
    upload = page.locator("[class*=st-key-upload_data_] input[type=file]")
    for number in count():
        name = f"table_{number}.csv"

        def act(name: str = name) -> None:
            expect(upload).to_have_count(1)  # the last file leaves an uploader of its own
            upload.set_input_files({"name": name, "mimeType": "text/csv", "buffer": content})
            expect(page.get_by_text(f"In use: {name}").first).to_be_visible()

        yield name, act


def photographs(page: Page) -> Iterator[Step]:
    upload = page.locator("[class*=st-key-upload_data_] input[type=file]")
    names: list[str] = []
    for whole, content in sorted(bar_set(7).files().items()):
        names.append(whole.split("/")[1])
        file = FilePayload(name=names[-1], mimeType="image/png", buffer=content)

        def act(file: FilePayload = file, there: int = len(names)) -> None:
            expect(upload).to_have_count(1)
            upload.set_input_files(file)
            expect(page.get_by_text(f"{there} photograph").first).to_be_visible()

        yield sorted(names), act


def calibrations(page: Page) -> Iterator[Step]:
    page.get_by_text("Settings", exact=True).click()
    for seed in count(1):

        def act(seed: int = seed) -> None:
            page.locator(".st-key-seed input").fill(str(seed))
            page.locator(".st-key-seed input").press("Enter")
            page.locator(".st-key-run button").click()
            expect(page.get_by_text(f"seed {seed}, essential").first).to_be_visible(
                timeout=LONGEST_MS
            )

        yield seed, act


def frames_left_out(page: Page) -> Iterator[Step]:
    page.locator(".st-key-run button").click()
    leave = page.locator(".st-key-frame_leave_out button")
    expect(leave).to_be_visible(timeout=LONGEST_MS)
    for number in count():

        def act(out: bool = number % 2 == 0) -> None:
            page.get_by_role("button", name="Leave it out" if out else "Put it back").click()
            said = "was left out by you" if out else "is used"
            expect(page.get_by_text(said).first).to_be_visible(timeout=LONGEST_MS)

        yield 1 - number % 2, act


def found_in(project: Project, activity: str) -> object:
    """What the project on disk holds, read by the library."""
    if activity == "tables":
        return project.inputs.labels["correspondences"]
    if activity == "photographs":
        return sorted(ProjectPhotographs(project).photographs)
    if activity == "calibrations":
        return project.calibration and project.calibration.settings.search.seed
    return len(project.inputs.left_out)


ACTIVITIES: dict[str, tuple[str, float, Callable[[Page], Iterator[Step]]]] = {
    "tables": ("data", 4.0, tables),
    "photographs": ("data", 8.0, photographs),
    "calibrations": ("calibrate", 10.0, calibrations),
    "frames_left_out": ("calibrate", 15.0, frames_left_out),
}
"""With the page, and within how many seconds the server is killed."""


@pytest.mark.parametrize("number", range(KILLS))
@pytest.mark.parametrize("activity", ACTIVITIES)
def test_nothing_acknowledged_is_lost(
    activity: str, number: int, page: Page, tmp_path: Path
) -> None:
    where, longest_s, act_on = ACTIVITIES[activity]
    project = a_project(tmp_path, FIELD)
    allowed = [found_in(project, activity)]
    with served(tmp_path) as (server, url):
        page.goto(f"{url}/{where}?project={project.id}")
        settle(page)
        moment = np.random.default_rng([number, len(activity)]).uniform(0.2, longest_s)
        killer = threading.Timer(moment, os.killpg, (server.pid, signal.SIGKILL))
        killer.start()
        page.set_default_timeout(5000)
        with suppress(Error, AssertionError):  # the server is gone
            for value, act in act_on(page):
                allowed.append(value)
                act()
                allowed = [value]
        killer.join()
        server.wait(20)
    again = Project.open(tmp_path, project.id)
    assert found_in(again, activity) in allowed
    _ = again.dataset, again.calibration, again.evaluation
    with served(tmp_path) as (_, url):
        page.goto(f"{url}/{where}?project={project.id}")
        settle(page)
        expect(page.get_by_test_id("stMain").locator("h1")).to_be_visible(timeout=LONGEST_MS)
        for wrong in ("cannot be read", "damaged", "no project at this address"):
            expect(page.get_by_text(wrong)).to_have_count(0)
    assert [each.id for each in recent_projects(tmp_path)] == [project.id]


def test_a_second_server_of_the_same_projects_says_so_and_ends(page: Page, tmp_path: Path) -> None:
    with served(tmp_path) as (first, url):
        page.goto(url)
        settle(page)
        with served(tmp_path) as (second, other):
            page.goto(other)
            expect(page.get_by_text("Another stereocal server")).to_be_visible(timeout=LONGEST_MS)
            assert second.wait(60) is not None
        assert first.poll() is None
        page.goto(url)
        settle(page)
        expect(page.get_by_text("Another stereocal server")).to_have_count(0)
    with served(tmp_path) as (_, url):  # once the first has ended
        page.goto(url)
        settle(page)
        expect(page.get_by_text("Another stereocal server")).to_have_count(0)
