"""From an installed wheel to both files: `stereocal serve`, away from any checkout."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import requests
from playwright.sync_api import Page, expect

from stereocal.cli import main
from tests.browser.conftest import LONGEST_MS, ROOT, download, results_shown, served, settle
from tests.wheel import installed_in

pytestmark = pytest.mark.browser


def test_an_installed_package_serves_the_recording_to_both_files(
    page: Page, tmp_path: Path
) -> None:
    command = ("-m", "stereocal", "serve", "--headless", "--port")
    environment = installed_in(tmp_path)
    # Now, so that the walk waits for the pages alone.
    subprocess.run(
        [sys.executable, "-m", "stereocal", "compile"],
        cwd=tmp_path,
        env=environment,
        check=True,
        capture_output=True,
    )
    with served(tmp_path / "home", environment, command, tmp_path) as (_, url):
        page.goto(url)
        settle(page)
        page.locator(".st-key-recording button").click()
        expect(page.get_by_text("818 pairs of points in 409 frames").first).to_be_visible(
            timeout=LONGEST_MS
        )
        settle(page)
        page.get_by_role("button", name="Next: Calibrate").click()
        settle(page)
        page.locator(".st-key-run button").click(timeout=LONGEST_MS)
        results_shown(page)
        settle(page)
        # The same as by the command line, but for date and name.
        assert (
            main(["calibrate", str(ROOT / "sample_data" / "recording"), "--out", str(tmp_path)])
            == 0
        )
        for method in ("2d", "3d"):
            shown = json.loads(download(page, f"download_{method}", tmp_path / "shown").read_text())
            printed = json.loads((tmp_path / f"parameters_{method}.json").read_text())
            for content in (shown, printed):
                assert content.pop("created")
                content["inputs"].pop("name")
            assert shown == printed


@pytest.mark.parametrize(("broken", "expected"), [(None, 200), ("stereocal/ui/navigation.py", 503)])
def test_the_health_check_sees_what_cannot_be_imported(
    broken: str | None, expected: int, tmp_path: Path
) -> None:
    """As the container asks it (Dockerfile)."""
    program = tmp_path / "program"
    for name in ("stereocal", "pages", "assets", ".streamlit"):
        shutil.copytree(ROOT / name, program / name)
    shutil.copy(ROOT / "app.py", program)
    if broken is not None:
        (program / broken).write_text("import nothing_of_that_name\n")
    enabled = {"STREAMLIT_SERVER_SCRIPT_HEALTH_CHECK_ENABLED": "true"}
    with served(tmp_path / "home", enabled, folder=program) as (_, url):
        asked = requests.get(f"{url}/_stcore/script-health-check", timeout=300)
        assert asked.status_code == expected
