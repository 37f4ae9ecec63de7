"""The Rig page, and the pages of a pair of a rig."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.ui.samples import three_cameras
from tests.pages.stored_projects import ROOT, SLOW, go, session, told
from tests.projects.test_recording import rig_text


@pytest.fixture
def project(home: Path) -> Project:
    """The sample of three cameras with its rig."""
    assert home.is_dir()
    found = three_cameras()
    ProjectRecording(found).keep_rig(rig_text(), b"zip")
    return found


def titles(app: AppTest) -> list[str]:
    return [str(title.value) for title in app.title]


def opened(project: Project, pair: str) -> AppTest:
    """The Calibrate page at the address of a pair."""
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    app.query_params["project"], app.query_params["pair"] = project.id, pair
    return go(app, "calibrate")


def test_a_pair_opens_todays_pages_and_leads_back(project: Project) -> None:
    app = go(session(project), "rig")
    assert "One rig of 3 cameras" in told(app)
    app.selectbox(key="rig_pair").set_value("2-3").run()
    app.button(key="rig_open_pair").click().run()
    assert titles(app) == ["Calibrate"] and not app.exception
    assert app.query_params["pair"] == "2-3"
    # Computed when first opened.
    pair = ProjectRecording(project).pair("2-3")
    assert pair.calibration is not None
    assert project.calibration is None
    assert "the lenses and the baseline of the rig" in told(go(app, "data"))
    for name in ("validate", "one_set", "apply", "check", "cameras"):
        assert not go(app, name).exception
        assert app.query_params["pair"] == "2-3"
    # The rig and Start are of the whole project.
    assert "One rig of 3 cameras" in told(go(app, "rig"))
    assert "pair" not in app.query_params
    cards = told(go(app, "start"))
    assert "One rig: 0." in cards and cards.count("3 cameras") == 1


def test_a_pair_opens_by_its_address(project: Project) -> None:
    app = opened(project, "1-3")
    assert app.text_input(key="project_name").value == "eWand, cameras 1, 2, 3, 1-3"
    app.button(key="run").click().run()
    assert ProjectRecording(project).pair("1-3").calibration is not None


def test_an_address_without_such_a_pair_is_reported(project: Project) -> None:
    assert 'There is no pair "1-9"' in told(opened(project, "1-9"), "error")
