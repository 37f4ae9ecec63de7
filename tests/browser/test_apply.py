"""The Apply page in a real browser: the job from the demo to the files, and a long one stopped."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stereocal.cli import main
from stereocal.rig.parameters import RigParameters
from tests.browser.conftest import LONGEST_MS, choose, download, results_shown
from tests.known_rig import PRIMARY, RIG, SECONDARY

pytestmark = pytest.mark.browser
Settled = Callable[[Page], None]
SET_2D = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {}, matching_threshold_px=0.8)


def histogram(page: Page) -> str:
    """All that the histogram draws: curves and the line of the threshold."""
    page.wait_for_timeout(1000)  # Plotly draws after the page is settled
    return str(
        page.locator("[class*=st-key-pair_errors] path").evaluate_all(
            "paths => paths.map(path => path.getAttribute('d')).join()"
        )
    )


def test_demo_to_files_of_the_command_line(
    page: Page, app_url: str, settled: Settled, tmp_path: Path
) -> None:
    page.goto(app_url)
    settled(page)
    page.locator(".st-key-demo button").click()
    expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()
    sidebar = page.get_by_test_id("stSidebar")
    sidebar.get_by_role("link", name="Calibrate").click()
    settled(page)
    page.get_by_role("button", name="Calibrate", exact=True).click()
    results_shown(page)
    settled(page)
    recommended = download(page, "download_refined", tmp_path)  # for both, so Apply takes it
    page.locator(".st-key-view").get_by_text("Parameters", exact=True).click()
    expect(page.locator(".st-key-format_file")).to_be_visible()
    settled(page)
    choose(page, "format_file", "3D set")
    expect(page.get_by_text("parameters_3d_opencv.zip").first).to_be_visible()
    settled(page)
    assert download(page, "download_format", tmp_path).read_bytes()[:2] == b"PK"

    sidebar.get_by_role("link", name="Apply").click()
    expect(page.get_by_text("50 pairs in 25 frames, none of them ambiguous").first).to_be_visible(
        timeout=LONGEST_MS
    )
    settled(page)
    page.get_by_text("Threshold and depths", exact=True).click()
    expect(page.get_by_text("have a partner within").first).to_be_visible()
    settled(page)
    before = histogram(page)
    box = page.locator(".st-key-apply_threshold input")
    box.fill("25")
    box.press("Enter")
    expect(page.get_by_text("have a partner within 25 px").first).to_be_visible()
    settled(page)
    assert histogram(page) != before
    page.get_by_text("In words, and on the command line").click()
    expect(
        page.get_by_text(re.compile("in 25 frames at a threshold of 25 px")).first
    ).to_be_visible()
    page.wait_for_timeout(500)  # until the fold has opened: its buttons move
    tables = [download(page, f"download_{which}", tmp_path) for which in ("primary", "secondary")]
    page.reload()
    expect(page.locator(".st-key-apply_threshold input")).to_have_value("25", timeout=LONGEST_MS)
    settled(page)
    mine = [download(page, f"download_{name}", tmp_path / "page") for name in ("pairs", "points")]

    sets = ["--parameters", str(recommended)]
    pairs = ["--threshold", "25", "--out", str(tmp_path / "pairs.csv")]
    points = ["--out", str(tmp_path / "points.csv")]
    assert main(["match", *map(str, tables), *sets, *pairs]) == 0
    assert main(["reconstruct", str(tmp_path / "pairs.csv"), *sets, *points]) == 0
    for path in mine:
        assert path.read_bytes() == (tmp_path / path.name).read_bytes()

    page.get_by_text("A known length", exact=True).click()
    expect(page.get_by_text("known length is 0.9 m").first).to_be_visible()


def test_frames_play_and_stop_by_keyboard(page: Page, app_url: str, settled: Settled) -> None:
    page.goto(app_url)
    settled(page)
    page.locator(".st-key-recording button").click()
    page.wait_for_url("**/data*")
    settled(page)
    page.get_by_test_id("stSidebar").get_by_role("link", name="Calibrate").click()
    settled(page)
    page.get_by_role("button", name="Calibrate", exact=True).click()
    results_shown(page)
    settled(page)
    page.get_by_test_id("stSidebar").get_by_role("link", name="Apply").click()
    expect(page.get_by_text(re.compile(r"^\d+ pairs in \d+ frames, none")).first).to_be_visible(
        timeout=LONGEST_MS
    )
    settled(page)
    slider = page.locator(".st-key-apply_frame input")
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
    settled(page)
    stopped = slider.get_attribute("aria-valuetext")
    page.wait_for_timeout(2000)
    assert slider.get_attribute("aria-valuetext") == stopped
