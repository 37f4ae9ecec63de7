"""The paper kit of the recording, from the page to the same files again."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest
from playwright.sync_api import Page

from stereocal.cli import main
from tests.browser.conftest import download, results_shown
from tests.browser.pictures import project_of_recording

pytestmark = pytest.mark.browser


def test_the_kit_of_the_page_is_computed_again(
    app_url: str, page: Page, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    project_of_recording(page, app_url)
    results_shown(page)
    kit = download(page, "download_kit", tmp_path)
    with zipfile.ZipFile(kit) as opened:
        assert "held-out frames" in opened.read("methods.md").decode()
        assert "figures/validation_180mm.pdf" in opened.namelist()
        opened.extract("archive.zip", tmp_path)
    asked = ["reproduce", str(tmp_path / "archive.zip"), "--out", str(tmp_path / "again")]
    assert main(asked) == 0
    assert capsys.readouterr().out.count(": identical") == 3
