"""All pages with all that can be opened on them: nothing leaves the host, names are never links,
and every download is a whole file."""

import io
import json
import re
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from stereocal.formats.camera_file import read_camera
from stereocal.projects.project import Project
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, one_of, open_folds, settle, visit
from tests.browser.work import FILE

pytestmark = pytest.mark.browser
FILES = {"calibrate": 4, "validate": 2, "apply": 3, "plan": 2, "cameras": 2, "data": 1}
"""Buttons for downloads that a page of a project with all results has at least."""
FIGURES = {"plan": 3, "cameras": 1, "data": 1, "calibrate": 1, "validate": 1, "apply": 3}
MOST_ROUNDS = 120
VIEWS = {
    "plan": ["Position error"],
    "cameras": ["Photograph by photograph", "What the lens leaves", "Without distortion"],
    "data": ["One frame"],
    "calibrate": ["Why two sets", "How accurate, where", "Residuals by place", "Searches"],
}
"""Figures that stand on the page only when somebody asks for them."""


def whole(name: str, content: bytes) -> bool:
    """Read a file by its ending."""
    ending = name.rsplit(".", 1)[-1]
    if ending == "json":
        return bool(json.loads(content))
    if ending == "csv":
        return len(pd.read_csv(io.BytesIO(content))) > 0
    if ending == "zip":
        return zipfile.ZipFile(io.BytesIO(content)).testzip() is None
    if ending == "svg":
        return ET.fromstring(content).tag.endswith("svg")
    if ending == "png":
        return cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED) is not None
    if ending in ("yaml", "yml"):
        return bool(read_camera(content, name).K.any())
    return content.startswith({"pdf": b"%PDF", "html": b"<!DOCTYPE"}[ending])


def downloads(page: Page, least: int) -> dict[str, bytes]:
    """The files of all buttons; parts that are computed come later, with folds of their own."""
    buttons = page.locator("[data-testid=stDownloadButton] button:enabled:visible")
    for _ in range(MOST_ROUNDS):
        open_folds(page)
        if buttons.count() >= least:
            break
    assert buttons.count() >= least
    found = {}
    for number in range(buttons.count()):
        with page.expect_download() as event:
            buttons.nth(number).click()
        found[event.value.suggested_filename] = Path(event.value.path()).read_bytes()
    return found


def links(page: Page) -> list[str]:
    found: list[str] = page.locator("a").evaluate_all("links => links.map(link => link.href)")
    return [link for link in found if "evil" in link]


def test_all_pages_ask_their_host_alone_have_no_link_and_give_whole_files(
    page: Page, app_url: str, finished: Project, tmp_path: Path
) -> None:
    finished.keep_settings({"validate_on": "All my data sets"})
    asked: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("websocket", lambda socket: asked.append(socket.url))
    said, files = 0, dict[str, bytes]()
    for name in TITLES:
        visit(page, app_url, name, finished)
        expect(page.get_by_text("held out here: not yet")).to_have_count(0, timeout=LONGEST_MS)
        if name in FIGURES:
            figures = page.locator(".js-plotly-plot:visible")
            expect(figures.nth(FIGURES[name] - 1)).to_be_visible(timeout=LONGEST_MS)
        here = downloads(page, FILES.get(name, 0))
        said += page.get_by_test_id("stMain").inner_text().count("evil.example")
        assert links(page) == [], name
        for key, content in here.items():
            assert whole(key, content), (name, key)
            files[key] = content
        for view in VIEWS.get(name, []):
            if name == "calibrate" and not one_of(page, view).count():
                page.get_by_role("button", name=re.compile("^More")).click()
            one_of(page, view).click()
            page.wait_for_timeout(300)
            settle(page)
    assert said > 10  # the names do stand there, as they are
    own = (app_url, app_url.replace("http", "ws", 1), "data:", "blob:")
    assert any(url.startswith("ws") for url in asked) and len(asked) > 50
    assert [url for url in asked if not url.startswith(own)] == []

    visit(page, app_url, "data", finished)
    bad = tmp_path / f"{FILE}.csv"
    bad.write_text("frame,target,u_primary,v_primary,u_secondary,v_secondary\n1,A,x,2,3,4\n")
    page.locator("[class*=st-key-upload_data_] input[type=file]").set_input_files(bad)
    alert = page.get_by_test_id("stAlert").filter(has_text="What was loaded before is unchanged")
    expect(alert).to_contain_text(f"{FILE}.csv")
    assert links(page) == []

    (report,) = (content for key, content in files.items() if key.endswith(".html"))
    (tmp_path / "report.html").write_bytes(report)
    asked.clear()
    page.goto((tmp_path / "report.html").as_uri())
    expect(page.locator(".js-plotly-plot .main-svg").first).to_be_visible()
    page.wait_for_load_state("networkidle")
    assert [url for url in asked if not url.startswith(("file:", "data:", "blob:"))] == []
