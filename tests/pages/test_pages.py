"""The pages without a browser: what they say, what they keep, and that no traceback shows."""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from tests.pages.stored_projects import messages

ROOT = Path(__file__).parents[2]
FIELD = ROOT / "sample_data" / "field"
SLOW = 120


def open_sample(app: AppTest) -> AppTest:
    app.button(key="demo").click().run()
    return app.switch_page("pages/data.py").run()


def project_of(app: AppTest, home: Path) -> Project:
    return Project.open(home, app.session_state["project_id"])


def zipped(files: dict[str, bytes]) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return packed.getvalue()


def test_every_page_says_what_it_lacks(app: AppTest) -> None:
    assert "Nothing is loaded yet" in messages(app.switch_page("pages/data.py").run())
    assert "it needs points, cameras" in messages(app.switch_page("pages/calibrate.py").run())


def test_sample_to_result_and_back_in_a_new_session(app: AppTest, home: Path) -> None:
    open_sample(app)
    assert "50 pairs of points in 25 frames" in messages(app)
    app.switch_page("pages/calibrate.py").run()
    assert "No result yet" in messages(app)
    app.slider(key="calibration_frames").set_value(20).run()
    app.button(key="run").click().run()
    assert "Use the refined set for both" in messages(app)
    result = project_of(app, home).calibration
    assert result is not None and len(result.frames) == 20

    again = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    again.query_params["project"] = app.session_state["project_id"]
    again.run().switch_page("pages/calibrate.py").run()
    assert "Use the refined set for both" in messages(again)
    assert again.slider(key="calibration_frames").value == 20


def test_real_recording_with_its_middle_marker_to_apply(app: AppTest, home: Path) -> None:
    app.button(key="recording").click().run()
    app.switch_page("pages/data.py").run()
    assert "818 pairs of points in 409 frames" in messages(app)
    project = project_of(app, home)
    read = read_dataset(FIELD.parent / "recording")
    assert project.dataset is not None and project.dataset.sha256 == read.sha256
    assert project.table is not None and b"time_frame" in project.table[1]
    store = ProjectApplication(project)
    for side in CAMERAS:
        points = store.points(side)
        assert points is not None and (points.rows, points.frames) == (409, 409)


def test_form_that_moved_on_is_said_and_the_result_stays(app: AppTest) -> None:
    open_sample(app).switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    app.number_input(key="delta").set_value(2e-3).run()
    assert "The form has changed since this result (Δ)" in messages(app)
    assert "Use the refined set for both" in messages(app)
    app.switch_page("pages/data.py").run()
    app.number_input(key="baseline_m_value").set_value(4.6).run()
    app.switch_page("pages/calibrate.py").run()
    assert "The data have changed since this result" in messages(app)
    assert app.number_input(key="delta").value == 2e-3


def test_settings_that_contradict_are_said_and_the_last_result_stays(app: AppTest) -> None:
    open_sample(app).switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    app.number_input(key="delta_min").set_value(0.1).run()
    app.button(key="run").click().run()
    assert "delta" in app.error[0].value and "it must be" in app.error[0].value
    assert "Use the refined set for both" in messages(app)


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "the file is empty"),
        (b"no zip", "not a valid zip"),
        (zipped({"a/readme.txt": b"x"}), "there is no dataset.json"),
        (zipped({"dataset.json": b"{}"}), "must be an object with"),
    ],
)
def test_bad_zip_is_said_and_nothing_is_lost(
    content: bytes, sentence: str, app: AppTest, home: Path
) -> None:
    open_sample(app)
    before = project_of(app, home).dataset
    app.segmented_control(key="data_how").set_value("A zip").run()
    app.file_uploader(key="upload_zip").upload("bad.zip", content, "application/zip").run()
    assert sentence in messages(app).replace("\\", "")
    assert "What was loaded before is unchanged" in messages(app)
    after = project_of(app, home).dataset
    assert before is not None and after is not None and before.sha256 == after.sha256


def test_good_zip_with_a_folder_inside(app: AppTest, home: Path) -> None:
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("A zip").run()
    dataset = read_dataset(FIELD)
    packed = zipped({f"my rig/{k}": v for k, v in pack_dataset(dataset).items()})
    app.file_uploader(key="upload_zip").upload("rig.zip", packed, "application/zip").run()
    assert "50 pairs of points in 25 frames" in messages(app)
    read = project_of(app, home).dataset
    assert read is not None and read.sha256 == dataset.sha256


@pytest.mark.parametrize(
    ("line", "column", "value", "reason"),
    [
        (5, 2, "x", 'u_primary is "x"'),
        (6, 3, "nan", "not a finite number"),
        (7, 4, "inf", "not a finite number"),
        (8, 1, "C", "it must be A or B"),
        (9, 2, "5000", "outside the 2336x1728 px image"),
    ],
)
def test_bad_row_is_listed_and_can_be_left_out(
    line: int, column: int, value: str, reason: str, app: AppTest
) -> None:
    open_sample(app)
    lines = (FIELD / "correspondences.csv").read_text().splitlines()
    cells = lines[line - 1].split(",")
    cells[column] = value
    lines[line - 1] = ",".join(cells)
    upload = app.file_uploader(key="upload_correspondences")
    upload.upload("points.csv", "\n".join(lines).encode(), "text/csv").run()
    refused = app.dataframe[0].value
    assert list(refused["Line"]) == [line]
    assert reason in refused["Refused because"][0]
    app.button(key="use_rest").click().run()
    assert "49 pairs of points in 25 frames" in messages(app)


@pytest.mark.parametrize(
    ("field", "value", "sentence"),
    [
        ("baseline_m", 0.0, "must be a length above 0"),
        ("baseline_m", 4500.0, "looks like millimetres"),
        ("target_distance_m", 0.0, "must be a length above 0"),
    ],
)
def test_bad_length_is_said_and_the_old_one_stays(
    field: str, value: float, sentence: str, app: AppTest, home: Path
) -> None:
    open_sample(app)
    app.number_input(key=f"{field}_value").set_value(value).run()
    assert sentence in messages(app)
    before = json.loads((FIELD / "dataset.json").read_text())[field]
    assert getattr(project_of(app, home).inputs, field) == before


def test_length_typed_before_anything_else(app: AppTest, home: Path) -> None:
    app.button(key="begin").click().run()
    app.switch_page("pages/data.py").run()
    app.selectbox(key="baseline_m_unit").set_value("cm").run()
    app.number_input(key="baseline_m_value").set_value(450.0).run()
    assert not app.exception and not app.error
    assert project_of(app, home).inputs.baseline_m == pytest.approx(4.5)
    assert app.number_input(key="baseline_m_value").value == 450.0
    assert app.selectbox(key="baseline_m_unit").value == "cm"


def test_lengths_in_another_unit_are_asked_about_once(app: AppTest, home: Path) -> None:
    open_sample(app)
    project = project_of(app, home)
    assert any("The cameras are 4.5 m apart" in item.value for item in app.markdown)
    project.give({}, baseline_m=450.0, target_distance_m=90.0)
    app.run()
    (asked,) = (item.value for item in app.warning if "in metres?" in item.value)
    assert "4.5 and 0.9 m if they are in cm" in asked
    app.button(key="in_metres").click().run()
    assert not app.warning and project.inputs.baseline_m == 450.0
    project.give({}, baseline_m=460.0)
    app.run()
    app.button(key="in_cm").click().run()
    assert not app.warning and not app.exception
    assert project.inputs.baseline_m == pytest.approx(4.6)
    assert project.inputs.target_distance_m == pytest.approx(0.9)
    assert app.number_input(key="baseline_m_value").value == pytest.approx(4.6)


def test_length_can_be_taken_back(app: AppTest, home: Path) -> None:
    open_sample(app)
    app.number_input(key="baseline_m_value").set_value(None).run()
    assert "Still missing: the baseline" in messages(app)
    assert project_of(app, home).inputs.baseline_m is None


def test_bad_point_is_listed_when_its_camera_comes(app: AppTest) -> None:
    app.switch_page("pages/data.py").run()
    rows = (FIELD / "correspondences.csv").read_text().splitlines()
    cells = rows[5].split(",")
    rows[5] = ",".join([*cells[:2], "2337", *cells[3:]])
    table = app.file_uploader(key="upload_correspondences")
    table.upload("points.csv", "\n".join(rows).encode(), "text/csv").run()
    camera = app.file_uploader(key="upload_primary")
    camera.upload("p.json", (FIELD / "primary.json").read_bytes(), "application/json").run()
    assert list(app.dataframe[0].value["Line"]) == [6]
    app.button(key="use_rest").click().run()
    assert not app.error
    assert "Still missing: the secondary camera's file" in messages(app)


def test_length_in_millimetres(app: AppTest, home: Path) -> None:
    open_sample(app)
    app.selectbox(key="target_distance_m_unit").set_value("mm").run()
    app.number_input(key="target_distance_m_value").set_value(900.0).run()
    assert project_of(app, home).inputs.target_distance_m == pytest.approx(0.9)
    app.switch_page("pages/calibrate.py").run()
    app.switch_page("pages/data.py").run()
    assert app.selectbox(key="target_distance_m_unit").value == "mm"
    assert app.number_input(key="target_distance_m_value").value == 900.0


def test_distance_in_wrong_unit_is_said_when_calibrating(app: AppTest) -> None:
    open_sample(app)
    app.number_input(key="target_distance_m_value").set_value(900.0).run()
    app.switch_page("pages/calibrate.py").run()
    app.button(key="run").click().run()
    assert "The distance looks like millimetres" in messages(app)


@pytest.mark.parametrize("address", ["0" * 32, "../../etc", "x"])
def test_address_of_no_project(address: str, home: Path) -> None:
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    app.query_params["project"] = address
    app.run().switch_page("pages/data.py").run()
    assert not app.exception
    assert "project" in app.error[0].value
    assert not (home / "projects").exists()
