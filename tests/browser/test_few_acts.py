"""From nothing to both files in few acts, with the mouse and by keyboard alone."""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Error, FileChooser, Page, expect

from stereocal.rig.parameters import RigParameters
from tests.browser.conftest import LONGEST_MS, ROOT, results_shown
from tests.browser.test_access import has_key, tab_to

pytestmark = pytest.mark.browser
Settled = Callable[[Page], None]
FIELD = ROOT / "sample_data" / "field"


def save(page: Page, method: str, press: Callable[[], None], folder: Path) -> None:
    """Fetch a parameter file by some act."""
    with page.expect_download() as event:
        press()
    event.value.save_as(folder / f"{method}.json")
    assert RigParameters.load(folder / f"{method}.json").method == method


FILES = {
    "correspondences": ("correspondences.csv", "Still missing: the primary camera's file"),
    "primary": ("primary.json", "Still missing: the secondary camera's file"),
    "secondary": ("secondary.json", "Still missing: the baseline"),
}
"""By upload, with what is missing after it."""


def taken(page: Page, lacking: str, settled: Settled) -> None:
    """Wait until the server has an upload: its page is drawn anew, and the focus would be lost."""
    expect(page.get_by_text("Still missing")).to_contain_text(lacking, timeout=LONGEST_MS)
    settled(page)
    page.wait_for_timeout(1000)


def open_chooser(page: Page, slot: str) -> FileChooser:
    """By keyboard; a key pressed while the page is drawn anew is lost, and pressed again."""
    for _ in range(5):
        tab_to(page, partial(uploads, slot))
        with suppress(Error), page.expect_file_chooser(timeout=5000) as chooser:
            page.keyboard.press("Enter")
            return chooser.value
    raise AssertionError("no chooser of files")


def uploads(slot: str, now: dict[str, Any]) -> bool:
    return has_key(f"upload_{slot}", now) and now["text"] == "Upload"


def test_the_recording_to_both_files_in_three_clicks(
    page: Page, app_url: str, settled: Settled, tmp_path: Path
) -> None:
    page.goto(app_url)
    settled(page)
    page.locator(".st-key-recording button").click()  # 1
    expect(page.get_by_text("818 pairs of points in 409 frames")).to_be_visible(timeout=LONGEST_MS)
    settled(page)
    page.get_by_role("button", name="Next: Calibrate").click()  # 2
    settled(page)
    page.locator(".st-key-run button").click()  # 3
    results_shown(page)
    settled(page)
    for method in ("2d", "3d"):
        save(page, method, page.locator(f".st-key-download_{method} button").click, tmp_path)


def test_a_table_of_ones_own_to_both_files_in_ten_acts(
    page: Page, app_url: str, settled: Settled, tmp_path: Path
) -> None:
    page.goto(app_url)
    settled(page)
    page.get_by_role("button", name="Start with my own data").click()  # 1
    expect(page).to_have_url(re.compile("/data"))
    settled(page)
    for slot, (name, lacking) in FILES.items():  # 2, 3, 4
        page.locator(f".st-key-upload_{slot} input[type=file]").set_input_files(FIELD / name)
        taken(page, lacking, settled)
    for key, metres in (("baseline_m_value", "4.5"), ("target_distance_m_value", "0.9")):  # 5, 6
        box = page.locator(f".st-key-{key} input")
        box.fill(metres)
        box.press("Enter")
        settled(page)
    expect(page.get_by_text("50 pairs of points in 25 frames")).to_be_visible()
    page.get_by_role("button", name="Next: Calibrate").click()  # 7
    settled(page)
    page.locator(".st-key-run button").click()  # 8
    results_shown(page)
    settled(page)
    for method in ("2d", "3d"):  # 9, 10
        save(page, method, page.locator(f".st-key-download_{method} button").click, tmp_path)


def test_a_table_of_ones_own_by_keyboard_alone(
    page: Page, app_url: str, settled: Settled, tmp_path: Path
) -> None:
    page.goto(app_url)
    settled(page)
    tab_to(page, lambda now: now["text"].endswith("Start with my own data"))
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile("/data"))
    settled(page)
    for slot, (name, lacking) in FILES.items():
        open_chooser(page, slot).set_files(FIELD / name)
        taken(page, lacking, settled)
    for key, metres in (("baseline_m_value", "4.5"), ("target_distance_m_value", "0.9")):
        tab_to(page, partial(has_key, key))
        page.keyboard.type(metres)
        page.keyboard.press("Enter")
        settled(page)
    expect(page.get_by_text("50 pairs of points in 25 frames")).to_be_visible()
    tab_to(page, lambda now: now["text"].endswith("Next: Calibrate"))
    page.keyboard.press("Enter")
    expect(page).to_have_url(re.compile("/calibrate"))
    settled(page)
    tab_to(page, partial(has_key, "run"))
    page.keyboard.press("Enter")
    results_shown(page)
    settled(page)
    used = page.get_by_text(re.compile(r"Frame \d+ is used\."))
    expect(used).to_be_visible(timeout=LONGEST_MS)
    tab_to(page, partial(has_key, "frame_leave_out"))
    page.keyboard.press("Enter")
    expect(page.get_by_text(re.compile(r"Frame \d+ was left out by you"))).to_be_visible(
        timeout=LONGEST_MS
    )
    results_shown(page)
    settled(page)
    for method, key in (("2d", "Enter"), ("3d", "Space")):
        tab_to(page, partial(has_key, f"download_{method}"))
        save(page, method, partial(page.keyboard.press, key), tmp_path)
