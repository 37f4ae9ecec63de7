"""From the sample to the verdict, along the trade-off, and to the refined set's file."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stereocal.rig.parameters import RigParameters
from tests.browser.conftest import LONGEST_MS, download, results_shown

pytestmark = pytest.mark.browser
Settled = Callable[[Page], None]


def test_verdict_slider_and_files(
    page: Page, app_url: str, settled: Settled, tmp_path: Path
) -> None:
    page.goto(app_url)
    settled(page)
    page.locator(".st-key-demo button").click()
    expect(page.get_by_text("50 pairs of points in 25 frames")).to_be_visible()
    page.get_by_role("button", name="Next: Calibrate").click()
    page.locator(".st-key-run button").click()
    results_shown(page)
    page.get_by_test_id("stSidebar").get_by_role("link", name="One set or two").click()
    expect(page.get_by_text("One set does both jobs here")).to_be_visible(timeout=LONGEST_MS)
    settled(page)
    assert "/one_set?project=" in page.url
    look_at = page.locator(".st-key-one_set_view")
    look_at.get_by_text("How accurate, where").click()
    expect(page.locator(".st-key-accuracy .js-plotly-plot")).to_be_visible()
    look_at.get_by_text("Matching against measuring").click()
    expect(page.locator(".st-key-trade_off .js-plotly-plot")).to_be_visible()
    # Nothing that was stated disagrees, so that a table says it all.
    expect(page.locator(".st-key-disagreement")).to_have_count(0)
    expect(page.get_by_role("rowheader", name="Baseline", exact=True)).to_be_visible()

    def at_the_point() -> str:
        settled(page)
        return page.get_by_text("At the slider's point").inner_text()

    before = at_the_point()
    point = RigParameters.load(download(page, "download_point", tmp_path))
    page.locator(".st-key-along").get_by_role("slider").focus()
    page.keyboard.press("End")
    expect(page.get_by_text(before)).to_have_count(0)
    assert at_the_point() != before  # settled: the button comes after the text
    other = RigParameters.load(download(page, "download_point", tmp_path))
    assert other.pose.angles != point.pose.angles

    refined = RigParameters.load(download(page, "download_refined", tmp_path))
    assert (refined.method, refined.purpose) == ("refined", "both")
    assert refined.matching_threshold_px is not None
    after = at_the_point()
    page.reload()
    expect(page.get_by_text("One set does both jobs here")).to_be_visible()
    assert at_the_point() == after  # a refresh loses nothing
    page.locator(".st-key-refined_2d label").click()  # as recommended until now
    settled(page)
    page.get_by_test_id("stSidebar").get_by_role("link", name="Apply").click()
    expect(page.locator(".st-key-apply_matching input")).to_have_value("2D set")
    expect(page.locator(".st-key-apply_measuring input")).to_have_value("Refined set · recommended")
