"""What the pages ask about files that can mean two things."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset
from stereocal.formats.exchange.exchange import export_files
from stereocal.projects.project import Project
from stereocal.system.zip_files import pack_zip
from tests.formats.test_no_silent_misreading import FOUR, INI, MAT, four, opencv_camera
from tests.formats.test_other_programs_points import (
    FRAMES,
    hdf5_bytes_of_deeplabcut,
    sleap_h5,
    tracktor,
)
from tests.known_rig import dataset
from tests.pages.test_apply import (
    SET_2D,
    SET_3D,
    begun,
    give_points,
    give_sets,
    said,
    store_of,
    written,
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


def test_four_coefficients_in_a_data_set(app: AppTest, home: Path) -> None:
    sound = dataset(8)
    files = pack_dataset(sound)
    description = json.loads(files["dataset.json"])
    description["cameras"]["secondary"] = "right.yml"
    files |= {"dataset.json": json.dumps(description).encode(), "right.yml": opencv_camera(FOUR)}
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("A zip").run()
    app.file_uploader(key="upload_zip").upload("rig.zip", pack_zip(files)).run()
    assert "right.yml" in said(app, "error") and "Which are they?" in said(app, "error")
    assert project_of(app, home).dataset is None
    app.button(key=USUAL).click().run()
    kept = project_of(app, home).dataset
    assert kept is not None and kept.sha256 == sound.sha256


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("left.ini", INI, "INI file"),
        ("left.mat", MAT, "MATLAB"),
    ],
)
def test_other_kinds_are_named(app: AppTest, name: str, content: bytes, says: str) -> None:
    app.switch_page("pages/data.py").run()
    app.file_uploader(key="upload_primary").upload(name, content).run()
    assert f"{name}: this" in said(app, "error") and says in said(app, "error")


def test_points_of_tracktor_and_sleap(app: AppTest, home: Path) -> None:
    give_points(begun(app), tracktor(0), sleap_h5(1))
    shown = [item.value for item in app.markdown]
    assert any("looks like Tracktor" in text for text in shown)
    assert any("looks like SLEAP" in text for text in shown)
    for side in ("primary", "secondary"):
        app.button(key=f"use_{side}").click().run()
    give_sets(app, SET_2D, SET_3D)
    pairs, _ = written(app, home)
    # SLEAP did not see one point of Tracktor's.
    assert len(pairs) == 2 * FRAMES - 1 and "id" in pairs and "track" in pairs
    np.testing.assert_allclose(pairs["error_px"], 0, atol=1e-6)


def test_a_file_of_deeplabcut_is_named(app: AppTest, home: Path) -> None:
    begun(app)
    uploader = app.file_uploader(key="upload_points_primary")
    uploader.upload("dlc.h5", hdf5_bytes_of_deeplabcut()).run()
    assert "DeepLabCut" in said(app, "error") and "CSV" in said(app, "error")
    assert store_of(app, home).asking("primary") is None
    app.switch_page("pages/data.py").run()
    uploader = app.file_uploader(key="upload_correspondences")
    uploader.upload("dlc.h5", hdf5_bytes_of_deeplabcut()).run()
    assert "DeepLabCut" in said(app, "error")


def test_a_table_that_is_no_wand_file_is_not_asked_about_as_one(app: AppTest) -> None:
    app.switch_page("pages/data.py").run()
    app.file_uploader(key="upload_correspondences").upload("t.csv", tracktor(0)).run()
    assert not any("looks like" in item.value for item in app.markdown)
    assert "columns" in said(app, "error") and "missing" in said(app, "error")


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


def test_parameters_that_say_it_all(app: AppTest, home: Path) -> None:
    begun(app)
    files = export_files(SET_2D, "ros")
    give_sets_of_another_program(app, "measuring", {"ros.zip": pack_zip(files)})
    app.selectbox(key="set_format_measuring").set_value("kalibr").run()
    assert said(app, "error")  # it is not Kalibr's
    app.selectbox(key="set_format_measuring").set_value("ros").run()
    app.button(key="use_set_measuring").click().run()
    kept = store_of(app, home).set_of("measuring")
    assert kept is not None
    np.testing.assert_allclose(kept[1].pose.T, SET_2D.pose.T, rtol=0, atol=1e-9)


def test_coefficients_need_the_image_sizes(app: AppTest, home: Path) -> None:
    begun(app)
    give_sets_of_another_program(app, "matching", export_files(SET_2D, "dlt"))
    app.selectbox(key="set_format_matching").set_value("dlt").run()
    assert "image size" in said(app, "error")
    for which, size in (("primary", (1600, 1200)), ("secondary", (1280, 1024))):
        for side, pixels in zip(("width", "height"), size, strict=True):
            app.number_input(key=f"set_size_matching_{which}_{side}").set_value(pixels).run()
    app.button(key="use_set_matching").click().run()
    kept = store_of(app, home).set_of("matching")
    assert kept is not None and kept[1].secondary.image_size == (1280, 1024)


def test_a_mat_of_parameters_is_named_and_files_are_put_aside(app: AppTest, home: Path) -> None:
    begun(app)
    give_sets_of_another_program(app, "matching", {"stereo.mat": MAT})
    assert "stereo.mat: this is a MATLAB file" in said(app, "error")
    give_sets_of_another_program(app, "matching", {"a.yml": b"%YAML:1.0\n---\nM1: 5\n"})
    app.selectbox(key="set_format_matching").set_value("opencv").run()
    assert "not a matrix" in said(app, "error")
    app.button(key="aside_matching").click().run()
    assert store_of(app, home).asking("matching") is None
