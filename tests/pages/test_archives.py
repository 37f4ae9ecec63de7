"""Files of other programs with both cameras, or a whole data set, on the Data page."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from tests.archives import easywand_fields, mat
from tests.known_rig import BAR_M, BASELINE_M
from tests.pages.test_apply import app as app
from tests.pages.test_apply import home as home
from tests.pages.test_apply import said
from tests.pages.test_asked import project_of

EASYWAND = mat({"easyWandData": easywand_fields(more_cameras=1)})


def give_easywand(app: AppTest, content: bytes = EASYWAND) -> AppTest:
    app.switch_page("pages/data.py").run()
    return app.file_uploader(key="upload_correspondences").upload("calib.mat", content).run()


def test_easywand_becomes_a_data_set(app: AppTest, home: Path) -> None:
    give_easywand(app)
    assert "3 cameras" in said(app, "caption")
    app.selectbox(key="archive_camera_1").select("cam3").run()
    assert "no end of the bar" in said(app, "error")
    app.selectbox(key="archive_camera_1").select("cam2").run()
    app.button(key="use_archive").click().run()
    assert not app.exception
    found = project_of(app, home).dataset
    assert found is not None
    assert found.baseline_m == pytest.approx(BASELINE_M)
    assert found.baseline_sigma_m == pytest.approx(0.02 * BASELINE_M)
    assert found.target_distance_m == BAR_M
    assert len(found.correspondences.frames) == 16


def test_lengths_that_were_entered_stay(app: AppTest, home: Path) -> None:
    app.switch_page("pages/data.py").run()
    app.number_input(key="baseline_m_value").set_value(2.5).run()
    give_easywand(app)
    app.button(key="use_archive").click().run()
    assert project_of(app, home).inputs.baseline_m == 2.5
    assert project_of(app, home).inputs.baseline_sigma_m is None


def test_a_free_baseline_is_found_from_the_lengths(app: AppTest, home: Path) -> None:
    give_easywand(app)
    app.button(key="use_archive").click().run()
    project = project_of(app, home)
    project.give({}, baseline_m=None)
    app.run()
    app.selectbox(key="baseline_m_known").select("Not measured").run()
    assert not app.exception
    found = project.dataset
    assert found is not None and found.baseline_is_free
    assert found.baseline_m == pytest.approx(BASELINE_M, rel=0.08)  # one focal length for fx and fy
    app.selectbox(key="baseline_m_known").select("Tape").run()
    assert not project.inputs.baseline_free
    assert "the baseline" in said(app, "warning")
