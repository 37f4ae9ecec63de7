"""Cameras that look through windows, on the pages."""

from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.calibration.mistakes import INTO_WATER
from stereocal.formats.dataset_files import pack_recording, parse_zip
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.project import Project
from stereocal.rig.recording import REFINED_ONLY
from stereocal.rig.window import StatedWindow
from stereocal.ui.intake import give_dataset
from stereocal.ui.page_states import page_states
from stereocal.ui.press import changed_since
from stereocal.ui.windows import EACH, NO, ONE, OTHER
from tests.pages.stored_projects import go, messages, page_of, run_job
from tests.rigs.behind_glass import Tank, submerged

BOTH = ("primary", "secondary")


NEAR = Tank(wall_m=0.03, turned_deg=2.0)
"""Whose images are nearly those of pinholes in water."""


def project_of(home: Path, tank: Tank, asked: bool = False) -> Project:
    drawn = submerged(tank, np.random.default_rng(3), bars=40)
    project = Project.create(home)
    give_dataset(project, pack_recording(drawn.asked() if asked else drawn.recording), "tank")
    return project


def is_together(project: Project) -> bool:
    return project.is_rig


def choose(app: AppTest, key: str, value: str) -> None:
    app.selectbox(key=key).set_value(value).run()


def test_the_window_of_two_cameras_is_stated_and_stays(home: Path) -> None:
    project = project_of(home, Tank())
    assert not is_together(project) and project.dataset is not None
    app = page_of(project, "data")
    assert app.selectbox(key="window_kind").value == NO
    choose(app, "window_kind", ONE)
    assert project.windows == (StatedWindow(BOTH, 0.01),) and is_together(project)
    app.number_input(key="window_thickness_mm").set_value(12.0).run()
    choose(app, "window_glass", "Acrylic (1.49)")
    choose(app, "window_medium", OTHER)
    app.number_input(key="window_medium_index").set_value(1.36).run()
    app.number_input(key="window_distance_primary").set_value(0.4).run()
    stated = StatedWindow(BOTH, 0.012, 1.49, 1.36, 0.4)
    again = page_of(project, "data")  # F5
    assert project.windows == (stated,) and not again.exception
    assert again.selectbox(key="window_medium").value == OTHER
    assert again.number_input(key="window_distance_primary").value == 0.4
    choose(again, "window_kind", EACH)
    assert [window.cameras for window in project.windows] == [("primary",), ("secondary",)]
    assert [window.distance_m for window in project.windows] == [None, None]
    again.number_input(key="window_distance_secondary").set_value(0.3).run()
    assert [window.distance_m for window in project.windows] == [None, 0.3]
    choose(again, "window_kind", NO)
    assert not (Project.open(home, project.id).windows or is_together(project) or again.exception)


def test_two_cameras_behind_a_window_are_calibrated_as_a_rig(home: Path, tmp_path: Path) -> None:
    project = project_of(home, Tank(), asked=True)
    assert is_together(project) and project.windows[0].cameras == BOTH
    app = page_of(project, "calibrate")
    run_job(app, "run", project, "rig")
    rig = project.rig
    assert rig is not None and all(camera.window for camera in rig.cameras.values())
    app = page_of(project, "calibrate")
    assert any(REFINED_ONLY in info.value for info in app.info)
    assert page_states(project)["validate"].mark == "missing"
    assert changed_since(project) == ""
    for page in ("validate", "cameras", "data"):
        go(app, page)
        assert not app.exception, page
    project.give({}, windows=[{"cameras": [*BOTH], "thickness_m": 0.02}])
    assert changed_since(project) == "windows"
    archive = tmp_path / "tank.zip"
    pack_project(project, archive)
    assert unpack_project(archive, "tank.zip", home).windows == project.windows
    assert parse_zip(archive.read_bytes(), "tank.zip").windows == project.windows
    project.give({}, windows=[])
    assert not is_together(project) and page_states(project)["calibrate"].mark == "missing"


def test_three_cameras_keep_the_windows_of_their_files_until_others_are_stated(home: Path) -> None:
    project = project_of(home, Tank(cameras=3), asked=True)
    (window,) = project.windows
    app = page_of(project, "data")
    assert app.selectbox(key="window_kind").value == ONE
    choose(app, "window_kind", NO)
    recording = project.recording
    assert project.windows == () and recording is not None and not recording.has_windows
    choose(app, "window_kind", ONE)
    assert project.recording is not None and project.recording.windows == (window,)
    assert not app.exception


def test_points_that_seem_to_be_of_water_are_calibrated_behind_a_window(home: Path) -> None:
    project = project_of(home, NEAR)
    app = page_of(project, "calibrate")
    run_job(app, "run", project, "calibration")
    assert INTO_WATER in messages(app)
    run_job(app, "behind_window", project, "rig")
    assert project.windows == (StatedWindow(BOTH, 0.01),) and project.rig is not None
    assert "behind_window" not in [button.key for button in app.button]


@pytest.mark.parametrize("wrong", [{"cameras": [*BOTH], "medium": 9.0}, {"medium": 1.3}])
def test_impossible_windows_are_refused(home: Path, wrong: dict[str, object]) -> None:
    project = project_of(home, Tank())
    with pytest.raises(ValueError):
        project.give({}, windows=[wrong])
    assert project.windows == ()
