"""The player of the Apply page in a real browser."""

import re

import pytest
from playwright.sync_api import Page, expect

from tests.browser.conftest import LONGEST_MS, results_shown, settle

pytestmark = pytest.mark.browser


def test_frames_play_and_stop_by_keyboard(page: Page, app_url: str) -> None:
    page.goto(app_url)
    settle(page)
    page.locator(".st-key-recording button").click()
    page.wait_for_url("**/data*")
    settle(page)
    page.get_by_test_id("stSidebar").get_by_role("link", name="Calibrate").click()
    settle(page)
    page.get_by_role("button", name="Calibrate", exact=True).click()
    results_shown(page)
    settle(page)
    page.get_by_test_id("stSidebar").get_by_role("link", name="Apply").click()
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
