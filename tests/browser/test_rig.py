"""Three cameras in a real browser: from Start to rig.json, and to a pair of them."""

from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stereocal.network.rig_file import RigFile
from tests.browser.conftest import LONGEST_MS, download, settle

pytestmark = pytest.mark.browser


def test_from_start_to_the_rig_and_to_a_pair(page: Page, app_url: str, tmp_path: Path) -> None:
    page.goto(app_url)
    settle(page)
    page.locator(".st-key-demo_rig button").click()
    page.locator(".st-key-rig_run button").click(timeout=LONGEST_MS)
    expect(page.get_by_text("One rig of 3 cameras").first).to_be_visible(timeout=LONGEST_MS)
    settle(page)
    found = RigFile.load(download(page, "rig_json", tmp_path))
    assert found.names == ["1", "2", "3"]
    expect(page.get_by_test_id("stSidebar").get_by_role("link", name="Rig")).to_be_visible()

    page.set_viewport_size({"width": 420, "height": 900})
    settle(page)
    assert page.evaluate("document.body.scrollWidth <= window.innerWidth")
    page.get_by_role("button", name="Pair 1-2").click()
    expect(page.get_by_role("heading", name="Calibrate", exact=True).first).to_be_visible(
        timeout=LONGEST_MS
    )
    expect(page.locator(".st-key-run button")).to_be_visible(timeout=LONGEST_MS)
