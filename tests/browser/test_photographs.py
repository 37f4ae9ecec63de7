"""The table of pairs of photographs in a real browser, changed by hand."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.bar_photographs import bar_set
from tests.browser.conftest import settle
from tests.files import write

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
