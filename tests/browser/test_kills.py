"""Servers that begin, of an installed wheel too, that are one too many, and that are killed: what a
page has acknowledged is there.

STEREOCAL_KILLS says how often each activity is killed.
"""

import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Error, FilePayload, Page, expect

from stereocal.cli import main
from stereocal.projects.home import recent_projects
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, ROOT, download, results_shown, served, settle
from tests.browser.work import a_project
from tests.photographs.bars import bar_set
from tests.wheel import installed_in

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
def test_nothing_acknowledged_is_lost(number: int, page: Page, tmp_path: Path) -> None:
    """One activity after the other, each looked at on the server that is killed next."""
    looks: list[tuple[str, str]] = []
    for activity, (where, longest_s, act_on) in ACTIVITIES.items():
        project = a_project(tmp_path, FIELD)
        allowed = [found_in(project, activity)]
        with served(tmp_path) as (server, url):
            look(page, url, looks)
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
        page.set_default_timeout(60_000)
        again = Project.open(tmp_path, project.id)
        assert found_in(again, activity) in allowed, activity
        _ = again.dataset, again.calibration, again.evaluation
        looks.append((where, project.id))
    with served(tmp_path) as (_, url):
        look(page, url, looks)
    assert {each.id for each in recent_projects(tmp_path)} == {found for _, found in looks}


def look(page: Page, url: str, looks: list[tuple[str, str]]) -> None:
    """At the project whose activity was killed last."""
    for where, project in looks[-1:]:
        page.goto(f"{url}/{where}?project={project}")
        settle(page)
        expect(page.get_by_test_id("stMain").locator("h1")).to_be_visible(timeout=LONGEST_MS)
        for wrong in ("cannot be read", "damaged", "no project at this address"):
            expect(page.get_by_text(wrong)).to_have_count(0)


WATCH = """
window.seen = []
let last = ''
setInterval(() => {
    const texts = (all) => [...document.querySelectorAll(all)].map((one) => one.innerText.trim())
    const now = { menu: texts('[data-testid=stSidebarNavLink] span:last-of-type'),
        titles: texts('h1') }
    if (JSON.stringify(now) === last) return
    last = JSON.stringify(now)
    window.seen.push(now)
}, 10)
"""


def open_new(page: Page, url: str, first: str) -> None:
    """Open the page of an address on a new server, whose first request imports the package for 3 s:
    a title and our menu stand there before, and never anything else."""
    page.goto(url)
    expect(page.get_by_text("Starting …").first).to_be_visible(timeout=LONGEST_MS)
    assert page.evaluate("window.seen.at(-1).titles") == [first]
    settle(page)
    expect(page.get_by_text("Starting …")).to_have_count(0)
    seen = page.evaluate("window.seen")
    menus = [now["menu"] for now in seen if now["menu"]]
    assert menus and all(menu == list(TITLES.values()) for menu in menus)
    assert all(len(now["titles"]) <= 1 for now in seen)


def test_a_new_server_and_a_second_one_of_the_same_projects(page: Page, tmp_path: Path) -> None:
    """The second says that there is another, and ends."""
    page.add_init_script(WATCH)
    said = page.get_by_text("Another stereocal server")
    with served(tmp_path) as (first, url):
        open_new(page, url, "stereocal")
        with served(tmp_path) as (second, other):
            page.goto(other)
            expect(said).to_be_visible(timeout=LONGEST_MS)
            assert second.wait(60) is not None
        assert first.poll() is None
        page.goto(url)
        settle(page)
        expect(said).to_have_count(0)
    with served(tmp_path) as (_, url):  # once the first has ended
        open_new(page, f"{url}/apply", "Apply")
        expect(said).to_have_count(0)


def test_an_installed_package_serves_a_sample_to_both_files(page: Page, tmp_path: Path) -> None:
    command = ("-m", "stereocal", "serve", "--headless", "--port")
    environment = installed_in(tmp_path)
    # Now, so that the walk waits for the pages alone.
    subprocess.run(
        [sys.executable, "-m", "stereocal", "compile"],
        cwd=tmp_path,
        env=environment,
        check=True,
        capture_output=True,
    )
    with served(tmp_path / "home", environment, command, tmp_path) as (_, url):
        page.goto(url)
        settle(page)
        page.locator(".st-key-demo button").click()
        expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible(
            timeout=LONGEST_MS
        )
        settle(page)
        page.get_by_role("button", name="Next: Calibrate").click()
        settle(page)
        page.locator(".st-key-run button").click(timeout=LONGEST_MS)
        results_shown(page)
        settle(page)
        # The same as by the command line, but for date and name.
        assert main(["calibrate", str(ROOT / "sample_data/field"), "--out", str(tmp_path)]) == 0
        for method in ("2d", "3d"):
            shown = json.loads(download(page, f"download_{method}", tmp_path / "shown").read_text())
            printed = json.loads((tmp_path / f"parameters_{method}.json").read_text())
            for content in (shown, printed):
                assert content.pop("created")
                content["inputs"].pop("name")
            assert shown == printed
