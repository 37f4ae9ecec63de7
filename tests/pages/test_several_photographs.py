"""Photographs of three cameras on the Data page, to a recording, without a browser."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from streamlit.testing.v1 import AppTest

from stereocal.formats.camera_file import write_camera
from stereocal.projects.home import find_projects
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.geometry import Pose
from tests.lens import PATTERN, SMALL, photographed, png
from tests.pages.stored_projects import go, told
from tests.pages.test_rig import given, titles
from tests.pages.waiting import ended, wait_until
from tests.photographed_rig import BAR_M
from tests.rigs.boards import HERE, placings, stereo
from tests.three_cameras import CAMERAS, photographed_bars

CORNERS = PATTERN.points - PATTERN.points.mean(axis=0)
"""Of a board whose pose is that of its middle."""


def give(app: AppTest, files: dict[str, bytes]) -> None:
    """One camera after the other, each in its own uploader."""
    for number, camera in enumerate(sorted(CAMERAS)):
        uploader = app.file_uploader(key=f"upload_of_camera_{number}_0")
        for name, content in files.items():
            folder, _, file = name.partition("/")
            if folder == camera:
                uploader.upload(file, content)
        uploader.run()
        assert not app.exception and not app.error


def search(app: AppTest, home: Path) -> ProjectRecording:
    app.button(key="find_everywhere").click().run()
    project = Project.open(home, find_projects(home)[0])
    job = ended(project, "photographs")
    assert job.state == "done", job.sentence
    app.run()
    assert not app.exception
    return ProjectRecording(project)


def test_photographs_of_a_bar_to_the_rig(app: AppTest, home: Path) -> None:
    files = dict(photographed_bars()[0])
    files["mid/0003.png"] = b"damaged"
    given(app, {f"{name}.json": write_camera(own) for name, own in CAMERAS.items()})
    give(app, files)
    store = search(app, home)
    assert "12 frames. Photographs not used: 1" in told(app, "caption")
    assert "mid/0003.png" in told(app, "markdown")
    app.number_input(key="several_B_m").set_value(BAR_M).run()
    app.button(key="several_run").click().run()
    assert titles(app) == ["Rig"]
    recording = store.read()
    assert recording is not None and {*recording.cameras} == {*CAMERAS}
    assert [len(recording.common_frames("mid", each)) for each in ("left", "right")] == [11, 11]
    wait_until(lambda: store.rig is not None)
    rig = store.rig
    assert rig is not None and rig.names == [*recording.cameras]
    # The photographs are still there; without one camera's, what was found is out of date.
    assert "have changed" not in told(go(app, "data"), "warning")
    app.button(key="several_clear").click().run()
    assert not app.exception and "left-mid" in told(app, "caption")


def seen_by_both(count: int) -> list[Pose]:
    """Boards that the rolled camera sees too."""
    size, rolled = np.array(SMALL.image_size), stereo(2.0)
    return [
        board
        for board in placings(stereo(0.0), 8 * count, 6)
        if (np.abs(SMALL.project((rolled @ board).apply(CORNERS)) - size / 2) < size / 2 - 25).all()
    ][:count]


def test_photographs_of_a_board(app: AppTest, home: Path) -> None:
    orders: dict[int, int] = {}
    poses = {"left": HERE, "mid": stereo(2.0), "right": stereo(0.0)}
    files = {
        f"{name}/{at}.png": png(photographed(pose @ board))
        for at, board in enumerate(seen_by_both(5))
        for name, pose in poses.items()
    }
    given(app, {f"{name}.json": write_camera(SMALL) for name in CAMERAS})
    give(app, files)
    assert app.segmented_control(key="held").value == "board"
    assert app.button(key="find_everywhere").disabled
    app.number_input(key="board_square_mm").set_value(30.0).run()
    recording = search(app, home).read()
    assert recording is not None and recording.object.board is not None
    assert min(len(recording.common_frames(*pair)) for pair in recording.pairs) >= 4
    # The corners of the rolled camera have the numbers of the others': one pose fits all boards.
    for number, name in enumerate(recording.cameras):
        for frame, board in zip(np.unique(recording.frame), seen_by_both(5), strict=True):
            rows = (recording.frame == frame) & (recording.camera == number)
            if not rows.any():
                continue
            true = SMALL.project((poses[name] @ board).apply(CORNERS))
            ways = [np.abs(recording.points[rows] - true[::way]).max() for way in (1, -1)]
            assert min(ways) < 1.0
            assert ways.index(min(ways)) == orders.setdefault(int(frame), ways.index(min(ways)))


def test_names_that_do_not_match_are_reported(app: AppTest, home: Path) -> None:
    assert home.is_dir()
    photo = photographed_bars()[0]["left/0001.png"]
    given(app, {f"{name}.json": write_camera(own) for name, own in CAMERAS.items()})
    give(app, {f"{camera}/{name}.png": photo for camera, name in zip(CAMERAS, "abc", strict=True)})
    assert "name those of one moment alike" in told(app, "warning")
