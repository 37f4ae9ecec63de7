"""A server is killed while it validates; the next one on the same projects goes on."""

from __future__ import annotations

import os
import re
import signal
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest
from playwright.sync_api import Page, expect

from stereocal.evaluation.evaluate import evaluate
from stereocal.projects.project import Project
from tests.browser.conftest import LONGEST_MS, served
from tests.projects.test_checkpoints import same_runs

pytestmark = pytest.mark.browser
SOME = re.compile(r"^\d+ of 500 runs")
"""It is killed as soon as some are finished, before all are."""


def test_a_killed_server_goes_on_with_a_validation(
    page: Page, tmp_path: Path, settled: Callable[[Page], None]
) -> None:
    with served(tmp_path) as (server, url):
        page.goto(url)
        settled(page)
        page.locator(".st-key-demo button").click()
        expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()
        page.get_by_test_id("stSidebar").get_by_role("link", name="Validate").click()
        expect(page.get_by_text("Match with the").first).to_be_visible(timeout=LONGEST_MS)
        page.locator(".st-key-validate_runs").get_by_role("slider").focus()
        page.keyboard.press("End")
        page.get_by_role("button", name="Validate (500 runs)").click()
        expect(page.get_by_text(SOME).first).to_be_visible(timeout=LONGEST_MS)
        project_id = parse_qs(urlsplit(page.url).query)["project"][0]
        os.killpg(server.pid, signal.SIGKILL)
        server.wait(20)
    with served(tmp_path) as (_, url):
        page.goto(f"{url}/validate?project={project_id}")
        # Finished runs are stored once a second: killed within the first, it had just begun.
        notice = page.get_by_text("The server stopped while this ran.").first
        expect(notice).to_be_visible(timeout=LONGEST_MS)
        page.get_by_role("button", name="Go on").click()
        expect(page.get_by_text(re.compile("^Made with: .* 500 runs")).first).to_be_visible(
            timeout=LONGEST_MS
        )
        expect(notice).to_have_count(0)
        page.get_by_text("Figures as a table").click()
        expect(page.locator("tr").first).to_be_visible()
        shown = " ".join(page.locator("tr").all_inner_texts())
        assert "2D set" in shown
    project = Project.open(tmp_path, project_id)
    found, dataset = project.evaluation, project.dataset
    assert found is not None and dataset is not None
    with ThreadPoolExecutor(2) as executor:
        whole = evaluate([dataset], found.settings, executor)
    assert whole is not None
    assert same_runs(list(found.runs[0]), whole[0])
