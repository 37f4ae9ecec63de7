"""The sample photographs on all pages, and photographs that cannot be used, without a browser."""

from __future__ import annotations

from pathlib import Path

from streamlit.testing.v1 import AppTest

from stereocal.projects.lens import ProjectLens
from stereocal.rig.camera import CAMERAS
from tests.pages.stored_projects import project_of, told
from tests.pages.test_cameras import boards as boards


def test_sample_photographs_fill_all_pages(app: AppTest, home: Path) -> None:
    app.button(key="demo_photographs").click().run()
    app.switch_page("pages/data.py").run()
    assert app.segmented_control(key="data_how").value == "Photographs"
    assert "50 photographs. 25 pairs by name" in told(app)
    assert app.number_input(key="baseline_m_value").value == 4.5
    assert not app.button(key="find_targets").disabled
    project = project_of(app, home)
    assert all(project.cameras)
    assert project.inputs.missing == ["the table of points"]
    assert "Still missing: the targets in the photographs (press *Find the targets*)" in told(app)
    for which in CAMERAS:
        assert len(ProjectLens(project, which).photographs) == 22
    app.switch_page("pages/cameras.py").run()
    assert "Of the primary camera: 22 photographs" in told(app)
    assert app.number_input(key="board_columns").value == 18
