"""A folder given whole in a real browser."""

from collections.abc import Callable

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import ROOT

pytestmark = pytest.mark.browser
FIELD = ROOT / "sample_data" / "field"


def test_folder_upload(page: Page, app_url: str, settled: Callable[[Page], None]) -> None:
    page.goto(f"{app_url}/data")
    settled(page)
    page.get_by_role("button", name="Give a whole folder").click()
    upload = page.locator("[class*=st-key-upload_data_folder_] input[type=file]")
    upload.set_input_files(FIELD)
    expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()
