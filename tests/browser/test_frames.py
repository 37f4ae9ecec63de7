"""From a figure to what it shows, and numbers typed into a table, in a real browser."""

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from stereocal.fit.screening.outliers import bar_frames
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from tests.browser.conftest import LONGEST_MS, settle, visit
from tests.pages.stored_projects import rig_of_three

pytestmark = pytest.mark.browser


def frame_of_largest_error(project: Project) -> int:
    """The frame with the largest length error of any set."""
    calibration = project.calibration
    assert calibration is not None
    errors = np.max([found.length for found in calibration.errors.values()], axis=0)
    return int(bar_frames(calibration)[np.argmax(errors)])


def points(page: Page) -> list[str]:
    """Where the symbols of the lower panel are."""
    symbols = page.locator(".st-key-frames .scatterlayer .point")
    expect(symbols.first).to_be_visible(timeout=LONGEST_MS)
    found: list[str] = []
    while True:  # Plotly draws after the page is settled
        page.wait_for_timeout(300)
        last, found = (
            found,
            page.locator(".st-key-frames .scatterlayer .point").evaluate_all(
                "all => all.map(one => one.getAttribute('transform'))"
            ),
        )
        if found == last:
            return found


def click_highest(page: Page) -> None:
    """Click on the symbol of the largest length error."""
    boxes = page.locator(".st-key-frames .scatterlayer .point").evaluate_all(
        "all => all.map(one => { const b = one.getBoundingClientRect();"
        " return [b.x + b.width / 2, b.y + b.height / 2]; })"
    )
    middle = sum(y for _, y in boxes) / len(boxes)
    x, y = min((box for box in boxes if box[1] > middle), key=lambda box: float(box[1]))
    page.mouse.move(x, y)
    page.wait_for_timeout(500)  # Plotly knows the point under the mouse only after a while
    page.mouse.click(x, y)


def test_an_outlier_is_clicked_and_left_out(page: Page, app_url: str, finished: Project) -> None:
    project = finished
    page.set_viewport_size({"width": 1400, "height": 3000})
    visit(page, app_url, "calibrate", project)
    before, outlier = points(page), frame_of_largest_error(project)
    shown = page.get_by_text(re.compile(r"Frame \d+ is used\.")).first
    if f"Frame {outlier} " in shown.inner_text():  # so that the click has something to change
        page.get_by_role("button", name="Previous frame").click()
        expect(shown).not_to_contain_text(f"Frame {outlier} ")
        settle(page)
        points(page)
    click_highest(page)
    expect(page.get_by_text(f"Frame {outlier} is used.").first).to_be_visible(timeout=LONGEST_MS)
    settle(page)
    page.get_by_role("button", name="Leave it out").click()
    expect(page.get_by_text(f"Left out by you: frame {outlier}.").first).to_be_visible(
        timeout=LONGEST_MS
    )
    settle(page)
    assert project.inputs.left_out == [outlier]
    assert points(page) != before


def test_a_line_between_cameras_chooses_the_pair(page: Page, app_url: str, home: Path) -> None:
    project = rig_of_three(home)
    page.set_viewport_size({"width": 420, "height": 900})
    page.goto(f"{app_url}/rig?project={project.id}")  # an address of before
    title = page.get_by_role("heading", name="Calibrate", exact=True).first
    expect(title).to_be_visible(timeout=LONGEST_MS)
    settle(page)
    assert page.evaluate("document.body.scrollWidth <= window.innerWidth")
    # The first pair is calibrated and validated without a press.
    expect(page.locator(".st-key-download_2d button")).to_be_enabled(timeout=LONGEST_MS)
    page.get_by_role("button", name="More").click()
    page.get_by_role("button", name="All cameras", exact=True).click()
    settle(page)
    graph = page.locator(".st-key-rig_graph .js-line").first
    graph.scroll_into_view_if_needed(timeout=LONGEST_MS)
    line = graph.bounding_box()
    assert line is not None
    page.mouse.click(line["x"] + line["width"] / 2, line["y"] + line["height"] / 2)
    expect(page.locator(".st-key-pair input")).not_to_have_value("1-2", timeout=LONGEST_MS)


def number_frame(page: Page, row: int, number: str) -> None:
    """Type a frame's number into the table of pairs, a canvas with rows of 35 px."""
    canvas = page.locator("[data-testid=stDataFrame] canvas").first
    canvas.scroll_into_view_if_needed()
    settle(page)  # the expander opens slowly, and moves the table
    box = canvas.bounding_box()
    assert box is not None
    page.mouse.dblclick(box["x"] + 0.33 * box["width"], box["y"] + 35 * (row + 1.5))
    field = page.locator("#portal input")
    field.fill(number)
    field.press("Enter")
    expect(field).to_have_count(0)


def test_pairs_are_changed_by_hand(page: Page, app_url: str, finished: Project) -> None:
    visit(page, app_url, "data", finished)
    page.get_by_text("The pairs as a table").click()
    expect(page.locator("[data-testid=stDataFrame] canvas").first).to_be_attached()
    for row, number in ((0, "101"), (1, "102"), (0, "103")):
        number_frame(page, row, number)
        page.wait_for_timeout(500)
        settle(page)
    store = ProjectPhotographs(finished)
    assert [row.pair.frame for row in store.rows][:3] == [103, 102, 3]
    page.reload()
    settle(page)
    assert [row.pair.frame for row in store.rows][:3] == [103, 102, 3]
