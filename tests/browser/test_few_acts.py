"""From Start to both parameter files, in few acts: a board, and a video of two balls.

An act is a click, a choice of files, or a number typed.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import Page, expect

from stereocal.detection.target import Balls
from stereocal.fit.rig_file import RigFile
from stereocal.formats.camera_file import write_camera
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.camera import CAMERAS
from stereocal.system.photograph import GreyImage, read_colours
from stereocal.ui.holding import held_target
from tests.browser.conftest import LONGEST_MS, ROOT, project_of, settle
from tests.photographs.ball_bars import BAR_M, CAMERA, RIG, ball_bars
from tools.photographs.videos import write_video

pytestmark = pytest.mark.browser
FRAMES = 12
MOST_ACTS = 9
BOARDS = ROOT / "sample_data" / "boards"


@dataclass
class User:
    """A person at the page, whose acts are counted."""

    page: Page
    acts: int = 0

    def press(self, name: str) -> None:
        """Press a button of a page that no longer draws: a click between two runs is lost."""
        self._wait()
        button = self.page.get_by_role("button", name=name)
        expect(button).to_be_enabled(timeout=LONGEST_MS)
        button.click()

    def give(self, files: Sequence[Path], to: str = "data_") -> None:
        """Choose files in the one place for files, or another."""
        self._wait()
        uploader = self.page.locator(f"[class*=st-key-upload_{to}] input[type=file]").first
        uploader.set_input_files(list(files))

    def enter(self, key: str, value: float | str) -> None:
        """Type a number or a name."""
        self._wait()
        field = self.page.locator(f".st-key-{key} input")
        field.fill(str(value))
        field.press("Enter")

    def download_both(self) -> None:
        """Save the files of the paper's two sets."""
        for method in ("2d", "3d"):
            self.download(f"download_{method}", f"parameters_{method}.json")

    def download(self, key: str, name: str) -> Path:
        """Save a file."""
        self._wait()
        button = self.page.locator(f".st-key-{key} button")
        expect(button).to_be_visible(timeout=LONGEST_MS)
        with self.page.expect_download() as saved:
            button.click()
        assert saved.value.suggested_filename == name
        return Path(saved.value.path())

    def sees(self, text: str) -> None:
        """The page shows a text, perhaps twice while it is drawn anew."""
        expect(self.page.get_by_text(text).first).to_be_visible(timeout=LONGEST_MS)

    def _wait(self) -> None:
        self.acts += 1
        self.page.wait_for_timeout(700)
        settle(self.page)


def test_board_photographs_to_both_files(page: Page, app_url: str, home: Path) -> None:
    page.goto(app_url)
    user = User(page)
    user.press("Start with my own data")
    user.give(sorted(BOARDS.glob("*.jpg")))
    user.sees("Corners of this board are dots")
    user.enter("board_square_mm", 25)
    user.press("Find the boards")
    user.sees("13 boards of 9x6 inner corners")
    user.press("Next: Calibrate")
    user.press("Calibrate")
    user.download_both()
    assert user.acts <= MOST_ACTS
    dataset = project_of(page, home).dataset
    assert dataset is not None and len(dataset.correspondences.frames) == 13


def filmed(which: str, folder: Path) -> Path:
    """The video of one camera."""
    files, _ = ball_bars(FRAMES)

    def draw(number: int) -> GreyImage:
        name = f"{which}/{number + 1:04}.png"
        return np.array(read_colours(files[name], name)[:, :, ::-1], np.uint8)

    seconds = [k / 25 for k in range(FRAMES)]
    return write_video(folder / f"{which}.mp4", seconds, draw=draw)


def test_videos_of_two_balls_to_both_files(
    page: Page, app_url: str, home: Path, tmp_path: Path
) -> None:
    pytest.importorskip("av")
    given = [filmed(which, tmp_path) for which in CAMERAS]
    for which in CAMERAS:
        given.append(tmp_path / f"{which}.json")
        given[-1].write_bytes(write_camera(CAMERA))
    page.goto(app_url)
    user = User(page)
    user.press("Start with my own data")
    user.give(given)
    user.sees(f"{FRAMES} pairs by name")
    # The colours are proposed from the frames; the photograph shows the balls that they find.
    user.sees("Both balls are found here")
    user.enter("baseline_m_value", round(float(np.linalg.norm(RIG.pose.T)), 6))
    user.enter("target_distance_m_value", BAR_M)
    user.press("Find the targets")
    user.sees(f"{FRAMES} frames:")
    project = project_of(page, home)
    frames = ProjectPhotographs(project).frames
    assert isinstance(held_target(project), Balls)
    assert frames is not None and sum(frame.use for frame in frames) >= 9
    # The photograph is folded away once the targets are found.
    user.sees("Pick the colours again")
    user.press("Next: Calibrate")
    user.press("Calibrate")
    user.download_both()
    assert user.acts <= MOST_ACTS


def test_a_folder_is_given_whole(page: Page, app_url: str) -> None:
    page.goto(f"{app_url}/data")
    settle(page)
    page.get_by_role("button", name="Give a whole folder").click()
    upload = page.locator("[class*=st-key-upload_data_folder_] input[type=file]")
    upload.set_input_files(ROOT / "sample_data" / "field")
    expect(page.get_by_text("50 pairs of points in 25 frames").first).to_be_visible()


@pytest.mark.parametrize(
    ("sample", "parameters", "matched"),
    [
        ("recording", ("download_refined", "parameters_refined.json"), "pairs.csv"),
        ("rig", ("download_rig_json", "rig.json"), "tracks.csv"),
    ],
)
def test_three_cameras_take_the_acts_of_two(
    page: Page, app_url: str, sample: str, parameters: tuple[str, str], matched: str
) -> None:
    """From Start to parameters, 3D points and a check, of real recordings of wands."""
    files = [*(ROOT / "sample_data" / sample).glob("*.*")]
    points = [path for path in files if path.name.startswith("points_")]
    data = [path for path in files if path.suffix != ".md" and path not in points]
    page.goto(app_url)
    user = User(page)
    user.press("Start with my own data")
    user.give(data)
    user.press("Next: Calibrate")
    user.press("Calibrate")
    found = user.download(*parameters)
    user.press("Next: Validate")
    user.press("Next: Apply")
    user.give(points, "points_")
    if sample == "rig":
        assert RigFile.loads(found.read_text()).names == ["1", "2", "3"]
    for name in (matched, "points.csv"):
        user.download(f"download_{name}".replace(".", "-"), name)
    user.press("Next: Check")
    user.give(data, "check_images_")
    user.sees("Cannot tell with these")
    assert user.acts == 12
