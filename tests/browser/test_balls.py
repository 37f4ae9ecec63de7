"""Two videos of a bar with two balls, in a real browser: each ball is clicked once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from stereocal.detection.target import Balls
from stereocal.formats.camera_file import write_camera
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph import GreyImage, decode_colours
from stereocal.ui.holding import held_target
from tests.ball_bars import CAMERA, ball_bars
from tests.browser.conftest import LONGEST_MS
from tests.videos import write_video

pytestmark = pytest.mark.browser
pytest.importorskip("av")
FRAMES = 12


def filmed(which: str, folder: Path) -> Path:
    """The video of one camera."""
    files, _ = ball_bars(FRAMES)

    def draw(number: int) -> GreyImage:
        name = f"{which}/{number + 1:04}.png"
        return np.array(decode_colours(files[name], name)[:, :, ::-1], np.uint8)

    seconds = [k / 25 for k in range(FRAMES)]
    return write_video(folder / f"{which}.mp4", seconds, draw=draw)


def test_videos_of_two_balls(
    page: Page, app_url: str, home: Path, settled: Callable[[Page], None], tmp_path: Path
) -> None:
    page.goto(f"{app_url}/data")
    settled(page)
    page.get_by_text("Photographs", exact=True).first.click()
    page.get_by_text("Two videos", exact=True).click()
    for which in CAMERAS:
        uploader = page.locator(f"[class*=st-key-upload_videos_][class*=_{which}] input[type=file]")
        uploader.set_input_files(filmed(which, tmp_path))
        settled(page)
    page.get_by_text("Keep the colours", exact=True).click()
    page.locator(".st-key-video_choice").get_by_role("combobox").click()
    page.get_by_role("option", name="Every n-th frame").click()
    settled(page)
    page.locator(".st-key-video_n input").fill("1")
    page.locator(".st-key-video_n input").press("Enter")
    settled(page)
    press(page, settled, "Take the frames")
    expect(page.get_by_text(f"{FRAMES} pairs by name").first).to_be_visible(timeout=LONGEST_MS)
    for which in CAMERAS:
        path = tmp_path / f"{which}.json"
        path.write_bytes(write_camera(CAMERA))
        page.locator(f".st-key-upload_{which} input[type=file]").set_input_files(path)
        expect(page.get_by_text(f"In use: {which}.json").first).to_be_visible()
    settled(page)
    page.get_by_text("Two balls", exact=True).click()
    expect(page.get_by_text("Click ball A, then ball B").first).to_be_visible()
    click_ball(page, settled, 0)
    expect(page.get_by_text("Click ball B, the other ball").first).to_be_visible()
    click_ball(page, settled, 1)
    expect(page.get_by_text("Both balls are found here").first).to_be_visible()

    press(page, settled, "Find the targets")
    expect(page.get_by_text(f"{FRAMES} frames:").first).to_be_visible(timeout=LONGEST_MS)
    project = Project.open(home, page.url.split("project=")[1][:32])
    frames = ProjectPhotographs(project).frames
    assert isinstance(held_target(project), Balls)
    assert frames is not None and sum(frame.use for frame in frames) >= 9
    # The photograph is folded away once the targets are found.
    expect(page.get_by_text("Pick the colours again").first).to_be_visible()


def press(page: Page, settled: Callable[[Page], None], name: str) -> None:
    """Press a button of a page that no longer draws: a click between two runs is lost."""
    page.wait_for_timeout(700)
    settled(page)
    button = page.get_by_role("button", name=name)
    expect(button).to_be_enabled()
    button.click()


def click_ball(page: Page, settled: Callable[[Page], None], which: int) -> None:
    """Click a ball of the first frame of the primary."""
    _, truth = ball_bars(FRAMES)
    u, v = truth["primary/0001.png"][which]
    canvas = page.locator(".st-key-pick_colour canvas")
    expect(canvas).to_be_visible()
    settled(page)
    canvas.scroll_into_view_if_needed()
    page.wait_for_timeout(700)  # the photograph is drawn when it is decoded
    box = canvas.bounding_box()
    assert box is not None
    width, height = CAMERA.image_size
    scale = min(box["width"] / width, box["height"] / height)
    page.mouse.click(
        box["x"] + 0.5 * box["width"] + scale * (u + 0.5 - 0.5 * width),
        box["y"] + 0.5 * box["height"] + scale * (v + 0.5 - 0.5 * height),
    )
    settled(page)
