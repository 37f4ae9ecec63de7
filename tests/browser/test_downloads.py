"""Every download button of every page gives a whole file."""

import io
import json
import xml.etree.ElementTree as ET
import zipfile
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from stereocal.formats.camera_file import read_camera
from stereocal.ui.menu import TITLES
from tests.browser.conftest import LONGEST_MS, settle

pytestmark = pytest.mark.browser
PAGES = [name for name in TITLES if name not in ("start", "help")]
LEAST = {"calibrate": 4, "validate": 2, "apply": 3, "plan": 2, "cameras": 2, "data": 1}
"""Buttons that a page of a project with all results has at least."""
MOST_ROUNDS = 60
OPEN = """[...document.querySelectorAll(
  "[data-testid=stExpander] details:not([open]) > summary")].forEach(each => each.click())"""


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


@pytest.mark.parametrize("path", PAGES)
def test_all_files_of_a_page(page: Page, app_url: str, finished: str, path: str) -> None:
    page.goto(f"{app_url}/{path}?project={finished}")
    expect(page.get_by_text("held out here: not yet")).to_have_count(0, timeout=LONGEST_MS)
    settle(page)
    buttons = page.locator("[data-testid=stDownloadButton] button:enabled:visible")
    for _ in range(MOST_ROUNDS):  # parts that are computed come later, with folds of their own
        page.evaluate(OPEN)
        page.wait_for_timeout(1000)  # folds open slowly
        settle(page)
        if buttons.count() >= LEAST.get(path, 0):
            break
    assert buttons.count() >= LEAST.get(path, 0)
    for number in range(buttons.count()):
        with page.expect_download() as event:
            buttons.nth(number).click()
        content = Path(event.value.path()).read_bytes()
        assert whole(event.value.suggested_filename, content), event.value.suggested_filename
