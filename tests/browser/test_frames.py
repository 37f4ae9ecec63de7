"""From the errors of a frame to the frame, and out of the calibration, in a real browser."""

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from stereocal.fit.screening.outliers import bar_frames
from stereocal.projects.project import Project
from tests.browser.conftest import LONGEST_MS, ROOT, results_shown, settle
from tests.browser.work import a_project

pytestmark = pytest.mark.browser
FIELD = ROOT / "sample_data" / "field"


def given(page: Page, app_url: str, home: Path) -> Project:
    """A project with the sample, opened on Calibrate and calibrated."""
    project = a_project(home, FIELD)
    page.goto(f"{app_url}/calibrate?project={project.id}")
    settle(page)
    page.locator(".st-key-run button").click()
    results_shown(page)
    settle(page)
    return project


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
        page.wait_for_timeout(1000)
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


def test_an_outlier_is_clicked_and_left_out(page: Page, app_url: str, home: Path) -> None:
    project = given(page, app_url, home)
    page.set_viewport_size({"width": 1400, "height": 3000})
    settle(page)
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
