"""What the pages ask about files that can mean two things."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from streamlit.testing.v1 import AppTest

from stereocal.projects.project import Project
from tests.formats.test_no_silent_misreading import FOUR, four, opencv_camera
from tests.pages.test_apply import (
    SET_2D,
    begun,
    said,
    store_of,
)
from tests.pages.test_apply import app as app
from tests.pages.test_apply import home as home

USUAL, FISHEYE = "use_rest", "use_other"


def project_of(app: AppTest, home: Path) -> Project:
    return Project.open(home, app.session_state["project_id"])


def test_four_coefficients_of_a_camera_file(app: AppTest, home: Path) -> None:
    app.switch_page("pages/data.py").run()
    app.file_uploader(key="upload_secondary").upload("right.yml", opencv_camera(FOUR)).run()
    assert "k1 k2 p1 p2" in said(app, "error") and "fisheye" in said(app, "error")
    assert "--lens-model" not in said(app, "error")  # nobody types that on a page
    assert "Camera file, secondary" not in said(app, "caption")
    app.button(key=FISHEYE).click().run()
    assert "is a fisheye" in said(app, "error")
    assert "in use" not in said(app, "caption").lower()
    app.file_uploader(key="upload_secondary").upload("right2.yml", opencv_camera(FOUR)).run()
    app.button(key=USUAL).click().run()
    assert said(app, "error") == ""
    assert "In use: right2.yml" in said(app, "caption")
    _, camera = project_of(app, home).cameras
    assert camera is not None
    np.testing.assert_array_equal(camera.distortion, FOUR)


def give_sets_of_another_program(app: AppTest, use: str, files: dict[str, bytes]) -> None:
    """All files of a program at once."""
    app.file_uploader(key=f"upload_set_{use}").set_value(
        [(name, content, "text/plain") for name, content in files.items()]
    ).run()


def test_parameters_of_another_program(app: AppTest, home: Path) -> None:
    """OpenCV's two files in millimetres, without k3: program, unit and lens are asked."""
    begun(app)
    give_sets_of_another_program(app, "matching", four("opencv", T=1000 * SET_2D.pose.T))
    assert store_of(app, home).set_of("matching") is None
    assert not said(app, "error")
    app.selectbox(key="set_format_matching").set_value("opencv").run()
    assert "k1 k2 p1 p2" in said(app, "info")
    app.selectbox(key="set_lens_matching").set_value("brown").run()
    assert "unit" in said(app, "info") and "mm (2.37 m)" in said(app, "info")
    assert "--unit" not in said(app)
    app.selectbox(key="set_unit_matching").set_value("mm").run()
    assert "2.37 m apart" in said(app, "caption")
    app.button(key="use_set_matching").click().run()
    kept = store_of(app, home).set_of("matching")
    assert kept is not None and kept[1].method == "imported"
    np.testing.assert_allclose(kept[1].pose.T, SET_2D.pose.T, rtol=0, atol=1e-12)
    assert store_of(app, home).asking("matching") is None
