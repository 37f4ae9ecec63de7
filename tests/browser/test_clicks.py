"""A biologist calibrates by photographs on a narrow screen, and measures in two videos: points
clicked frame by frame, on the page Apply."""

import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from playwright.sync_api import Page, expect

from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from tests.browser.conftest import ROOT, choose, download, project_of, settle
from tests.browser.test_access import violations
from tests.browser.test_few_acts import User
from tests.browser.test_review import Photograph

pytestmark = pytest.mark.browser
FLIGHT = ROOT / "sample_data" / "flight"
TRUTH = json.loads((FLIGHT / "truth.json").read_text())
PHOTOGRAPHS = ROOT / "sample_data" / "photographs"
MOST_ACTS, FRAMES = 20, 5


class Clicker(User):
    """A person who clicks in the pictures."""

    def click(self, camera: str, end: int, frame: int) -> None:
        """On an end in one picture."""
        self._wait()
        picture = Photograph(self.page, f"clicks_{camera}", "")
        self.page.mouse.click(*picture.screen(*TRUTH[camera][frame - 1][end]))
        self.page.wait_for_timeout(300)

    def key(self, key: str) -> None:
        self._wait()
        self.page.keyboard.press(key)

    def choose(self, key: str, option: str) -> None:
        self._wait()
        choose(self.page, key, option)

    def open(self, name: str) -> None:
        self._wait()
        self.page.get_by_test_id("stSidebar").get_by_role("link", name=name).click()


def calibrate_by_photographs(user: Clicker, home: Path, folder: Path) -> Project:
    """From Start to both files, on a narrow screen."""
    given = [shutil.copy(PHOTOGRAPHS / f"{which}.json", folder) for which in CAMERAS]
    for which, name, first in (("primary", "IMG_{}", 1001), ("secondary", "DSC_{:04}", 231)):
        for number, file in enumerate(sorted((PHOTOGRAPHS / which).iterdir()), first):
            given.append(shutil.copy(file, folder / f"{name.format(number)}.jpg"))
    user.press("Start with my own data")
    user.give(list(map(Path, given)))
    user.sees("Which photographs are the primary camera's?")
    user.press("IMG_1001 to IMG_1025 (25)")
    user.sees("In use: primary.json (primary camera), secondary.json (secondary camera), 25 + 25")
    user.enter("baseline_m_value", 4.5)
    user.enter("target_distance_m_value", 0.9)
    user.press("Find the targets")
    user.sees("25 frames: ")
    user.press("Next: Calibrate")
    user.press("Calibrate")
    user.download_both()
    assert user.acts <= 10
    project = project_of(user.page, home)
    result = project.calibration
    assert result is not None and len(result.frames) == 21
    assert result.refined is not None
    truth = json.loads((PHOTOGRAPHS / "truth.json").read_text())["angles"]
    off = np.degrees(result.refined.pose.angles.yaw - truth["yaw"])
    assert abs(off) < 0.02, off  # measured: 0.002 degrees
    return project


def test_from_photographs_to_both_files_and_the_length_of_something_that_flies(
    page: Page, app_url: str, home: Path, tmp_path: Path
) -> None:
    pytest.importorskip("av")
    page.set_viewport_size({"width": 420, "height": 900})
    page.goto(app_url)
    user = Clicker(page)
    project = calibrate_by_photographs(user, home, tmp_path)
    page.set_viewport_size({"width": 1400, "height": 1000})
    user.acts = 0
    user.open("Apply")
    user.choose("apply_points", "Click them here")
    for camera in CAMERAS:  # one after the other
        user.give([FLIGHT / f"{camera}.mp4"], "footage")
    user.sees("Pictures: primary.mp4, secondary.mp4, 10 frames")
    store = ProjectClicks(project)
    for end, track in enumerate(("head", "tail")):
        user.enter("clicks_track", track)
        user.sees(f"Click {track} in one of the pictures.")
        user.click("primary", end, 1)
        user.sees(f"Now click {track} in the secondary picture, near the line.")
        assert len(store.clicks.every) == 4 * end // 2 + 1  # on disk when it is seen
        user.click("secondary", end, 1)
        user.sees("below the threshold of")
    user.enter("clicks_track", "F and A")
    user.sees("Click F and A in one of the pictures.")
    user.enter("clicks_track", "tail")
    user.key("f")  # the field has not kept the keys
    for frame in range(2, FRAMES + 1):
        expect(page.get_by_label(f"Frame {frame} of the primary camera").first).to_be_visible()
        user.sees("Accept 4 and go on")
        user.key("a")
    user.sees("tail to head, mean of 5 frames: ")
    found = page.get_by_text("tail to head, mean of 5 frames: ").first.inner_text()
    metres, sigma = map(float, re.findall(r"mean of 5 frames: ([\d.]+) ± ([\d.]+) m", found)[0])
    assert abs(metres - TRUTH["length_m"]) < 3 * sigma < 0.02  # measured: 0.4201 ± 0.0025
    user.press("Match and measure all (20 clicks)")
    user.sees("10 pairs in 5 frames, none of them ambiguous")
    assert user.acts <= MOST_ACTS, user.acts  # measured: 17
    user.choose("clicks_to", "The target there")
    user.click("primary", 0, 1)
    user.sees("There is no corner of four squares near")
    assert not violations(page)
    settle(page)
    points = pd.read_csv(download(page, "download_points", tmp_path))
    assert sorted(points["track"]) == ["head"] * 5 + ["tail"] * 5
    off = [
        math.dist(row[["x", "y", "z"]], TRUTH["ends_m"][row["frame"] - 1][row["track"] == "tail"])
        for _, row in points.iterrows()
    ]
    assert max(off) < 0.06, off  # measured: 0.03, at 13 m
    page.keyboard.press("u")
    expect(page.get_by_role("button", name="Match and measure all (16 clicks)")).to_be_visible()
    assert len(store.clicks.every) == 16
