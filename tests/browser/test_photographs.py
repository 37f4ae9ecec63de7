"""Photographs in a real browser: from files to points, with the pairs changed by hand."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stereocal.formats.camera_file import write_camera
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.bar_photographs import bar_set, write
from tests.browser.conftest import LONGEST_MS

pytestmark = pytest.mark.browser
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


def test_photographs_to_points(
    page: Page, app_url: str, home: Path, settled: Callable[[Page], None], tmp_path: Path
) -> None:
    files = {name.split("/")[1]: content for name, content in BARS.files().items()}
    files["right3.png"] = files["right3.png"][:-500]
    write(files, tmp_path)
    page.goto(f"{app_url}/data")
    settled(page)
    page.get_by_text("Photographs", exact=True).first.click()
    uploader = page.locator("[class*=st-key-upload_photographs_] input[type=file]")
    uploader.set_input_files([tmp_path / name for name in sorted(files)])
    expect(page.get_by_text("28 photographs. 14 pairs by name").first).to_be_visible()
    for slot in ("primary", "secondary"):
        path = tmp_path / f"{slot}.json"
        path.write_bytes(write_camera(getattr(BARS.rig, slot)))
        page.locator(f".st-key-upload_{slot} input[type=file]").set_input_files(path)
        expect(page.get_by_text(f"In use: {slot}.json").first).to_be_visible()

    settled(page)  # a run that still draws the pairs closes them again
    page.get_by_text("The pairs: look at them").click()
    expect(page.locator("[data-testid=stDataFrame] canvas").first).to_be_attached()
    settled(page)
    for row, number in ((0, "101"), (1, "102"), (0, "103")):
        number_frame(page, row, number)
        page.wait_for_timeout(500)
        settled(page)
    store = store_of(page, home)
    assert [row.pair.frame for row in store.rows][:3] == [103, 102, 3]

    page.get_by_role("button", name="Find the targets").click()
    expect(page.get_by_text("14 frames: 13 found, 0 doubtful, 1 refused").first).to_be_visible(
        timeout=LONGEST_MS
    )
    expect(page.get_by_text("right3.png: the PNG is cut off").first).to_be_visible()
    settled(page)
    page.wait_for_timeout(1500)
    settled(page)
    # Nothing asks the server on its own any more: the page is not redrawn while nobody acts.
    runs = page.evaluate(
        """() => new Promise(done => {
            let runs = 0
            const app = document.querySelector('[data-testid=stApp]')
            const seen = new MutationObserver(() => { runs += 1 })
            seen.observe(app, {attributes: true, attributeFilter: ['data-test-script-state']})
            setTimeout(() => { seen.disconnect(); done(runs) }, 2500)
        })"""
    )
    assert runs == 0
    page.get_by_text("Refused (1)").click()
    expect(page.locator("[data-testid=stImage] img")).to_have_count(1)
    page.reload()
    expect(page.get_by_text("14 frames: 13 found").first).to_be_visible()
    assert store.frames is not None
    assert [frame.frame for frame in store.frames][:3] == [103, 102, 3]
