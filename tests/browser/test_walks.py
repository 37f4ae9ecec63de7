"""Walks in a real browser: the first load, pairs changed by hand, a rig, the player of Apply."""

import re
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Page, expect

from stereocal.fit.rig_file import RigFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.ui.menu import TITLES
from tests.bar_photographs import bar_set
from tests.browser.conftest import LONGEST_MS, download, open_page, results_shown, serve, settle
from tests.files import write

pytestmark = pytest.mark.browser


def test_frames_play_and_stop_by_keyboard(page: Page, app_url: str) -> None:
    page.goto(app_url)
    settle(page)
    page.locator(".st-key-recording button").click()
    page.wait_for_url("**/data*")
    open_page(page, "Calibrate")
    page.locator(".st-key-run button").click()  # again, where another walk has opened the sample
    results_shown(page)
    open_page(page, "Apply")
    expect(page.get_by_text(re.compile(r"^\d+ pairs in \d+ frames, none")).first).to_be_visible(
        timeout=LONGEST_MS
    )
    settle(page)
    slider = page.locator("[class*=st-key-apply_frame_] input")
    slider.focus()
    page.keyboard.press("ArrowRight")
    expect(page.get_by_text("Frame 1: 1 pair").first).to_be_visible()
    play = page.locator(".st-key-apply_play button")
    play.focus()
    page.keyboard.press("Enter")
    played = page.get_by_text(re.compile(r"^Frame ([3-9]|\d\d+): "))
    expect(played).to_be_visible(timeout=LONGEST_MS)
    play.focus()
    page.keyboard.press("Enter")
    expect(play).to_contain_text("Play", timeout=LONGEST_MS)
    settle(page)
    stopped = slider.get_attribute("aria-valuetext")
    page.wait_for_timeout(2000)
    assert slider.get_attribute("aria-valuetext") == stopped


def test_from_start_to_the_rig_and_to_a_pair(page: Page, app_url: str, tmp_path: Path) -> None:
    page.goto(app_url)
    settle(page)
    page.locator(".st-key-demo_rig button").click()
    expect(page.get_by_role("heading", name="Data", exact=True)).to_be_visible(timeout=LONGEST_MS)
    settle(page)
    page.locator(".st-key-next button").click()
    page.locator(".st-key-run button").click(timeout=LONGEST_MS)
    expect(page.get_by_text("One rig of 3 cameras").first).to_be_visible(timeout=LONGEST_MS)
    settle(page)
    found = RigFile.load(download(page, "download_rig_json", tmp_path))
    assert found.names == ["1", "2", "3"]

    # The first pair is calibrated and validated without another press.
    expect(page.locator(".st-key-download_2d button")).to_be_enabled(timeout=LONGEST_MS)
    page.set_viewport_size({"width": 420, "height": 900})
    settle(page)
    assert page.evaluate("document.body.scrollWidth <= window.innerWidth")
    page.get_by_role("button", name="More").click()
    page.get_by_role("button", name="All cameras", exact=True).click()
    settle(page)
    graph = page.locator(".st-key-rig_graph .js-line").first
    graph.scroll_into_view_if_needed()
    line = graph.bounding_box()
    assert line is not None
    page.mouse.click(line["x"] + line["width"] / 2, line["y"] + line["height"] / 2)
    expect(page.locator(".st-key-pair input")).not_to_have_value("1-2", timeout=LONGEST_MS)
    page.goto(page.url.replace("/calibrate", "/rig"))  # an address of before
    expect(page.get_by_role("heading", name="Calibrate", exact=True).first).to_be_visible(
        timeout=LONGEST_MS
    )


BARS = bar_set(14)


def store_of(page: Page, home: Path) -> ProjectPhotographs:
    return ProjectPhotographs(Project.open(home, page.url.split("project=")[1][:32]))


def number_frame(page: Page, row: int, number: str) -> None:
    """Type a frame's number into the table of pairs, a canvas with rows of 35 px."""
    canvas = page.locator("[data-testid=stDataFrame] canvas").first
    canvas.scroll_into_view_if_needed()
    page.wait_for_timeout(700)  # the expander opens slowly, and moves the table
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.dblclick(box["x"] + 0.33 * box["width"], box["y"] + 35 * (row + 1.5))
    field = page.locator("#portal input")
    field.fill(number)
    field.press("Enter")
    expect(field).to_have_count(0)


def test_pairs_are_changed_by_hand(page: Page, app_url: str, home: Path, tmp_path: Path) -> None:
    files = {name.split("/")[1]: content for name, content in BARS.files().items()}
    write(files, tmp_path)
    page.goto(f"{app_url}/data")
    settle(page)
    uploader = page.locator("[class*=st-key-upload_data_] input[type=file]")
    uploader.set_input_files([tmp_path / name for name in sorted(files)])
    expect(page.get_by_text("28 photographs. 14 pairs by name").first).to_be_visible()
    settle(page)  # a run that still draws the pairs closes them again
    page.get_by_text("The pairs as a table").click()
    expect(page.locator("[data-testid=stDataFrame] canvas").first).to_be_attached()
    settle(page)
    for row, number in ((0, "101"), (1, "102"), (0, "103")):
        number_frame(page, row, number)
        page.wait_for_timeout(500)
        settle(page)
    store = store_of(page, home)
    assert [row.pair.frame for row in store.rows][:3] == [103, 102, 3]

    page.reload()
    expect(page.get_by_text("28 photographs. 14 pairs").first).to_be_visible()
    assert [row.pair.frame for row in store.rows][:3] == [103, 102, 3]


WATCH = """
window.seen = []
let last = ''
setInterval(() => {
    const texts = (all) => [...document.querySelectorAll(all)].map((one) => one.innerText.trim())
    const now = { menu: texts('[data-testid=stSidebarNavLink] span:last-of-type'),
        titles: texts('h1'), bars: texts('[data-testid=stProgress]').length,
        asked: !!document.querySelector('[data-test-script-state=running]') }
    if (JSON.stringify(now) === last) return
    last = JSON.stringify(now)
    window.seen.push({ ...now, ms: performance.now() })
}, 10)
"""


def seen(page: Page) -> list[dict[str, Any]]:
    return list(page.evaluate("window.seen"))


@pytest.mark.parametrize(("path", "first"), [("", "stereocal"), ("apply", "Apply")])
def test_a_new_server_shows_a_title_and_our_menu_and_nothing_else(
    page: Page, tmp_path: Path, path: str, first: str
) -> None:
    """The first request imports the package for 3 s: the title and the menu stand before."""
    page.add_init_script(WATCH)
    with serve(tmp_path) as url:
        page.goto(f"{url}/{path}")
        expect(page.get_by_text("Starting …").first).to_be_visible(timeout=LONGEST_MS)
        assert seen(page)[-1]["titles"] == [first]
        settle(page)
        expect(page.get_by_text("Starting …")).to_have_count(0)
        menus = [now["menu"] for now in seen(page) if now["menu"]]
        assert menus and all(menu == list(TITLES.values()) for menu in menus)
        assert all(len(now["titles"]) <= 1 for now in seen(page))
