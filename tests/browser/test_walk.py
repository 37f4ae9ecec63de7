"""The main job in a real browser against a real server."""

import json
from pathlib import Path

import pytest
from playwright.sync_api import Page, expect

from stereocal.cli import main
from stereocal.rig.parameters import RigParameters
from tests.browser.conftest import LONGEST_MS, ROOT, choose, download, results_shown, settle

pytestmark = pytest.mark.browser
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
    page: Page, app_url: str, tmp_path: Path
) -> None:
    page.goto(f"{app_url}/data")
    settle(page)
    missing = page.get_by_text("Still missing").first
    for name, lacking in (
        ("correspondences.csv", "the primary camera's file, the secondary"),
        ("primary.json", "Still missing: the secondary camera's file"),
        ("secondary.json", "Still missing: the baseline"),
    ):
        settle(page)  # the last file leaves an uploader of its own
        upload = page.locator("[class*=st-key-upload_data_] input[type=file]")
        upload.set_input_files(RECORDING / name)
        expect(missing).to_contain_text(lacking)
    settle(page)
    box = page.locator(".st-key-baseline_m_value input")
    box.fill("4.976")
    box.press("Enter")
    expect(missing).to_contain_text("Still missing: the distance between the targets")
    settle(page)
    choose(page, "target_distance_m_unit", "mm")
    settle(page)
    box = page.locator(".st-key-target_distance_m_value input")
    box.fill("390")
    box.press("Enter")
    expect(page.get_by_text("818 pairs of points in 409 frames").first).to_be_visible()
    page.get_by_role("button", name="Next: Calibrate").click()
    settle(page)
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
