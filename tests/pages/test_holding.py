"""What stands on the bar, as stated on the Data page, without a browser."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.detection.target import BAR, Balls, Tags
from stereocal.formats.camera_file import write_camera
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.ui.holding import held_target
from tests.ball_bars import CAMERA, COLOURS, ball_bars
from tests.pages.stored_projects import go, messages, session
from tests.pages.waiting import ended


@pytest.fixture
def balls(home: Path) -> Project:
    """A project with photographs of two balls, and the lenses."""
    project = Project.create(home)
    store = ProjectPhotographs(project)
    files, _ = ball_bars(12)
    store.add({name: store.keep(name, content) for name, content in files.items()})
    lens = write_camera(CAMERA)
    project.give({"primary": ("p.json", lens), "secondary": ("s.json", lens)})
    return project


def test_balls_are_stated_and_found(balls: Project) -> None:
    app = go(session(balls), "data")
    assert held_target(balls) == BAR
    app.segmented_control(key="held").set_value("balls").run()
    assert "Click ball A" in messages(app) and app.button(key="find_targets").disabled
    app.text_input(key="held_balls").set_value("red,blurple").run()
    assert "blurple" in messages(app) and app.button(key="find_targets").disabled
    app.text_input(key="held_balls").set_value(COLOURS.partition(":")[2]).run()
    assert "Both balls are found here" in messages(app)
    app.button(key="find_targets").click().run()
    store = ProjectPhotographs(balls)
    ended(balls, "photographs")
    frames = store.frames
    assert frames is not None and sum(frame.use for frame in frames) >= 10
    assert isinstance(held_target(balls), Balls)
    assert "Find them again" not in messages(app.run())
    app.segmented_control(key="held").set_value("tags").run()
    assert "what you said before that you hold" in messages(app) and not app.exception


def test_tags_are_stated(balls: Project) -> None:
    app = go(session(balls), "data")
    app.segmented_control(key="held").set_value("tags").run()
    app.text_input(key="held_tags").set_value("4X4_50:3").run()
    assert "tags:4X4_50:3,7" in messages(app) and app.button(key="find_targets").disabled
    app.text_input(key="held_tags").set_value("4X4_50:3,7").run()
    assert held_target(balls) == Tags("4X4_50", (3, 7))
    assert not app.button(key="find_targets").disabled and not app.exception


def test_tags_are_printed_before_there_is_a_project(app: AppTest) -> None:
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="print_what").set_value("tags").run()
    assert any("Print at 100 %" in item.value for item in app.markdown)
    app.number_input(key="print_tag_mm").set_value(300.0).run()
    assert "do not fit on A4" in messages(app)
    app.text_input(key="print_tags").set_value("4X4_50:3").run()
    assert "tags:4X4_50:3,7" in messages(app)
