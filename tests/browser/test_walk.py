"""The main job in a real browser against a real server."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from stereocal.cli import main
from stereocal.rig.parameters import RigParameters
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, ROOT, choose, download, results_shown, serve

pytestmark = pytest.mark.browser
Settled = Callable[[Page], None]
FIELD = ROOT / "sample_data" / "field"
RECORDING = ROOT / "sample_data" / "recording"


def calibrate(page: Page) -> None:
    page.locator(".st-key-run button").click()
    results_shown(page)


def same_but_for_the_date(one: Path, other: Path) -> bool:
    contents = [json.loads(path.read_text()) for path in (one, other)]
    for content in contents:
        assert content.pop("created")
        content["inputs"].pop("name")
    return bool(contents[0] == contents[1])


def show_parameters(page: Page) -> None:
    view = page.locator(".st-key-view").get_by_text("Parameters", exact=True)
    expect(view).to_have_count(1, timeout=LONGEST_MS)  # two while the page is drawn again
    view.first.click()


def row_of(page: Page, name: str) -> list[str]:
    """The cells of one row of the tables of parameters."""
    row = page.locator("tr", has_text=name)
    expect(row).to_be_visible(timeout=LONGEST_MS)
    return [cell.strip() for cell in row.locator("td").all_inner_texts()]


def test_upload_real_recordings_and_compare_with_the_command_line(
    page: Page, app_url: str, settled: Settled, tmp_path: Path
) -> None:
    page.goto(f"{app_url}/data")
    settled(page)
    page.get_by_text("Single files", exact=True).click()
    settled(page)
    missing = page.get_by_text("Still missing").first
    for slot, name, lacking in (
        ("correspondences", "correspondences.csv", "the primary camera's file, the secondary"),
        ("primary", "primary.json", "Still missing: the secondary camera's file"),
        ("secondary", "secondary.json", "Still missing: the baseline"),
    ):
        page.locator(f".st-key-upload_{slot} input[type=file]").set_input_files(RECORDING / name)
        expect(missing).to_contain_text(lacking)
    box = page.locator(".st-key-baseline_m_value input")
    box.fill("4.976")
    box.press("Enter")
    expect(missing).to_contain_text("Still missing: the distance between the targets")
    settled(page)
    choose(page, "target_distance_m_unit", "mm")
    settled(page)
    box = page.locator(".st-key-target_distance_m_value input")
    box.fill("390")
    box.press("Enter")
    expect(page.get_by_text("818 pairs of points in 409 frames").first).to_be_visible()
    page.get_by_role("button", name="Next: Calibrate").click()
    settled(page)
    calibrate(page)
    show_parameters(page)
    reprojection = [float(cell.split()[0]) for cell in row_of(page, "Reprojection error, mean")]
    length = [float(cell.split()[0]) for cell in row_of(page, "Length error, median (%)")]
    assert len(reprojection) == len(length) == 4
    assert reprojection[1] < reprojection[2] and length[2] < length[1]  # the paper's point

    assert main(["calibrate", str(RECORDING), "--out", str(tmp_path / "cli")]) == 0
    for method, purpose in (("2d", "matching"), ("3d", "reconstruction")):
        mine = download(page, f"download_{method}", tmp_path)
        assert mine.name == f"parameters_{method}.json"
        assert RigParameters.load(mine).purpose == purpose
        assert same_but_for_the_date(mine, tmp_path / "cli" / mine.name)


def test_sample_to_downloads_with_a_refresh_and_a_restart(
    page: Page, browser: Browser, settled: Settled, tmp_path: Path
) -> None:
    home = tmp_path / "home"
    with serve(home) as url:
        page.goto(url)
        settled(page)
        page.locator(".st-key-demo button").click()
        expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()
        page.reload()
        expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()
        page.get_by_test_id("stSidebar").get_by_role("link", name="Calibrate").click()
        settled(page)
        calibrate(page)
        show_parameters(page)
        rows = ("Reprojection error, mean", "Yaw", "Stopped because")
        table = [row_of(page, name) for name in rows]
        address = page.url
        assert re.search(r"/calibrate\?project=[0-9a-f]{32}$", address)

        page.reload()
        settled(page)
        assert [row_of(page, name) for name in rows] == table
        second = browser.new_context(accept_downloads=True).new_page()
        second.goto(address)
        settled(second)
        assert row_of(second, "Yaw") == table[1]
        second.context.close()
        page.goto("about:blank")
    with serve(home) as url:  # a bookmark is the first address that the new server gets
        page.goto(re.sub(r"http://[^/]+", url, address))
        expect(page.get_by_test_id("stSidebarNavLink").locator("p")).to_have_text(
            list(TITLES.values()), timeout=LONGEST_MS
        )
        settled(page)
        expect(page.get_by_text("Page not found")).to_have_count(0)
        assert row_of(page, "Yaw") == table[1]
        files = [download(page, f"download_{method}", tmp_path) for method in ("2d", "3d")]
    truth = json.loads((FIELD / "truth.json").read_text())
    for path in files:
        pose = RigParameters.load(path).pose
        assert np.abs(pose.R - np.array(truth["R"])).max() < 5e-3


def test_folder_upload(page: Page, app_url: str, settled: Settled) -> None:
    page.goto(f"{app_url}/data")
    settled(page)
    page.get_by_role("radiogroup", name="I have").get_by_text("A folder").click()
    page.locator(".st-key-upload_folder input[type=file]").set_input_files(FIELD)
    expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()


def test_validation_follows_the_controls_and_a_long_run_can_be_cancelled(
    page: Page, app_url: str, settled: Settled, tmp_path: Path
) -> None:
    page.goto(app_url)
    settled(page)
    page.locator(".st-key-demo button").click()
    expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()
    page.get_by_test_id("stSidebar").get_by_role("link", name="Validate").click()
    expect(page.get_by_text("Match with the").first).to_be_visible(timeout=LONGEST_MS)

    def state() -> tuple[str, str]:
        """All cells of the table, and all curves of the figure."""
        settled(page)
        page.wait_for_timeout(1000)  # Plotly draws after the page is settled
        curves = page.locator(".st-key-validation .cartesianlayer path").evaluate_all(
            "paths => paths.map(path => path.getAttribute('d')).join()"
        )
        assert len(curves) > 1000
        return " ".join(page.locator("tr").all_text_contents()), curves  # the table is folded

    seen = [state()]
    for field, made_with in (("delta", "Δ 0.1,"), ("acceptance", "acceptance ratio 0.99,")):
        page.locator(f".st-key-{field}").get_by_role("slider").focus()
        page.keyboard.press("End")
        expect(page.get_by_text(re.compile(rf"^Made with: .*{made_with}")).first).to_be_visible()
        seen.append(state())
    page.locator(".st-key-validate_frames").get_by_role("slider").focus()
    page.keyboard.press("ArrowLeft")
    expect(
        page.get_by_text(re.compile("^Made with: .* 19 calibration frames")).first
    ).to_be_visible()
    seen.append(state())
    tables, figures = zip(*seen, strict=True)
    assert len(set(tables)) == len(seen)
    assert len(set(figures)) == len(seen)

    page.locator(".st-key-validate_runs").get_by_role("slider").focus()
    page.keyboard.press("End")
    page.locator(".st-key-validate_on").get_by_text("Nineteen synthetic rigs").click()
    page.get_by_role("button", name="Validate (9500 runs)").click()
    page.locator(".st-key-cancel_evaluation button").click()
    expect(page.get_by_text("Cancelled. What is shown is the last finished").first).to_be_visible()
    expect(
        page.get_by_text(re.compile("^Made with: .* 100 runs, 19 calibration")).first
    ).to_be_visible()
    assert state() == seen[-1]

    page.locator(".st-key-validate_on").get_by_text("My data set").click()
    with page.expect_download() as event:
        page.locator(".st-key-download_summary button").click()
    event.value.save_as(tmp_path / "summary.json")
    assert json.loads((tmp_path / "summary.json").read_text())["settings"]["runs"] == 100
