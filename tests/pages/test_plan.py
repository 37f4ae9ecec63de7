"""The Plan page, without a browser."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.field.planning.forecast import forecast
from stereocal.formats.camera_file import write_camera
from stereocal.formats.plan_file import parse_plan, write_plan
from stereocal.projects.project import Project
from stereocal.ui.plan_project import planned_line
from stereocal.ui.samples import SAMPLES
from stereocal.verdict.in_words import percent
from tests import known_rig
from tests.field.plans import FIELD, contents, plan
from tests.pages.stored_projects import FULL, go, messages, placed, session, told

ROOT = Path(__file__).parents[2]
SLOW = 120


@pytest.fixture
def app(app: AppTest) -> AppTest:
    return go(app, "plan")


def open_plan(app: AppTest, files: dict[str, bytes]) -> AppTest:
    widget = app.file_uploader(key="upload_plan")
    for name, content in files.items():
        widget.upload(name, content)
    return app.run()


def test_it_answers_at_once_and_without_a_project(app: AppTest, home: Path) -> None:
    assert "at 25 m" in messages(app) and "Limited by" in messages(app)
    assert "project_id" not in app.session_state
    assert not list(home.glob("projects/*.sqlite"))


def test_the_answer_follows_the_controls(app: AppTest) -> None:
    before = messages(app)
    app.number_input(key="plan_noise_px").set_value(0.4).run()
    assert not app.error and messages(app) != before
    app.select_slider(key="plan_far_m").set_value(20.0).run()
    assert "at 20 m" in messages(app)
    # Values stay when the page is left.
    app.switch_page("pages/start.py").run()
    app.switch_page("pages/plan.py").run()
    assert app.number_input(key="plan_noise_px").value == 0.4
    assert "at 20 m" in messages(app)


def test_a_plan_that_cannot_work_is_one_message(app: AppTest) -> None:
    app.slider(key="plan_toe_in_deg").set_value(60.0).run()
    assert len(app.error) == 1 and "nothing in common" in messages(app)
    app.slider(key="plan_toe_in_deg").set_value(10.0).run()
    assert not app.error and "Limited by" in messages(app)


def test_the_two_cameras_may_differ(app: AppTest) -> None:
    app.toggle(key="plan_alike").set_value(False).run()
    app.selectbox(key="plan_secondary_camera").set_value("Other: sensor and pixels").run()
    assert app.number_input(key="plan_secondary_width_px").value == 6000
    assert not app.error and "Limited by" in messages(app)


def test_a_plan_is_opened_with_its_camera_files(app: AppTest) -> None:
    cameras = {"primary": "left.json", "secondary": contents()["cameras"]["secondary"]}
    content = json.dumps(contents(cameras=cameras, bar_m=1.25, frames=33)).encode()
    open_plan(app, {"plan.json": content})
    assert "names the camera file left.json" in messages(app)
    open_plan(app, {"plan.json": content, "left.json": write_camera(known_rig.PRIMARY)})
    assert not app.error
    assert app.number_input(key="plan_bar_m").value == 1.25
    assert app.select_slider(key="plan_frames").value == 33
    assert app.selectbox(key="plan_primary_camera").value == "A camera file"
    assert str(app.selectbox(key="plan_secondary_camera").value).startswith("IDT M5")


def test_four_coefficients_are_asked_about(app: AppTest) -> None:
    four = {
        "camera_matrix": known_rig.SECONDARY.K.tolist(),
        "distortion_coefficients": known_rig.SECONDARY.distortion.tolist(),
        "image_size": list(known_rig.SECONDARY.image_size),
    }
    app.selectbox(key="plan_primary_camera").set_value("A camera file").run()
    assert "Give the file of the primary camera" in messages(app)
    app.file_uploader(key="upload_plan_primary").upload("lens.json", json.dumps(four).encode())
    app.run()
    assert "Which are they?" in messages(app)
    app.button(key="use_rest").click().run()
    assert any("1280 x 1024 px" in item.value for item in app.caption)
    named = {"primary": "lens.json", "secondary": contents()["cameras"]["secondary"]}
    content = json.dumps(contents(cameras=named, frames=40)).encode()
    open_plan(app, {"plan.json": content, "lens.json": json.dumps(four).encode()})
    assert "Which are they?" in messages(app)
    app.button(key="use_rest").click().run()
    assert app.select_slider(key="plan_frames").value == 40


def test_an_opened_plan_shows_its_own_numbers_on_sliders_too(app: AppTest) -> None:
    near = {"near_m": 2.123, "far_m": 2.4}
    changes: dict[str, Any] = {
        "pose": {"baseline_m": 4.01, "toe_in_deg": 62.25, "height_difference_m": 0.0},
        "volume": near,
        "bar_m": 0.0123,
        "noise_px": 19.5,
        "frames": 77,
    }
    open_plan(app, {"plan.json": json.dumps(contents(**changes)).encode()})
    assert app.select_slider(key="plan_baseline_m").value == 4.01
    assert app.slider(key="plan_toe_in_deg").value == 62.25
    assert app.select_slider(key="plan_near_m").value == 2.123
    assert app.select_slider(key="plan_frames").value == 77
    assert app.number_input(key="plan_noise_px").value == 19.5


def test_damaged_settings_do_no_harm(app: AppTest, home: Path) -> None:
    app.button(key="plan_start").click().run()
    project = Project.open(home, app.session_state["project_id"])
    project.keep_settings(
        {
            "plan_bar_m": "x",
            "plan_stated_pose": {"R": 1, "T": 2},
            "plan_compared": ["{", 7],
            "plan_primary_camera": "none",
            "plan_frames": 2.5,
            "plan_toe_in_deg": 1e9,
            "plan_near_m": [1],
            "plan_forecast": {"methods": 3},
        }
    )
    app.switch_page("pages/plan.py").run()
    assert not app.error and "Limited by" in messages(app)


def test_a_stated_pose_is_kept_until_it_is_replaced(app: AppTest) -> None:
    one = plan(stated_pose=FIELD.pose)
    open_plan(app, {"plan.json": write_plan(one)})
    assert not app.error and any("R and T of the plan" in item.value for item in app.markdown)
    app.button(key="plan_aim").click().run()
    assert not app.error and app.select_slider(key="plan_baseline_m").value == 4.5


def test_what_is_no_plan_is_refused(app: AppTest) -> None:
    open_plan(app, {"camera.json": write_camera(known_rig.PRIMARY)})
    assert "plan.json" in messages(app) and "Limited by" in messages(app)


def test_three_plans_side_by_side(app: AppTest) -> None:
    for name, noise in (("first", 0.3), ("second", 0.5)):
        app.text_input(key="plan_name").set_value(name).run()
        app.number_input(key="plan_noise_px").set_value(noise).run()
        app.button(key="plan_keep").click().run()
    app.text_input(key="plan_name").set_value("third").run()
    app.number_input(key="plan_noise_px").set_value(0.1).run()
    shown = " ".join(item.value for item in app.markdown)
    assert all(f"**{name}" in shown for name in ("first", "second", "third"))
    assert app.button(key="plan_keep").disabled
    app.button(key="plan_show_0").click().run()
    assert app.number_input(key="plan_noise_px").value == 0.3
    assert app.text_input(key="plan_name").value == "first"
    app.button(key="plan_drop_0").click().run()
    assert not app.button(key="plan_keep").disabled


def test_a_project_from_a_plan(app: AppTest, home: Path) -> None:
    one = plan(name="two boats", stated_primary=known_rig.PRIMARY, near_m=9.0)
    open_plan(app, {"plan.json": write_plan(one)})
    app.button(key="plan_start").click().run()
    assert not app.error and app.title[0].value == "Data"
    project = Project.open(home, app.session_state["project_id"])
    inputs = project.inputs
    assert inputs.name == "two boats"
    assert (inputs.baseline_m, inputs.target_distance_m) == pytest.approx((4.5, 0.9))
    assert inputs.planned == ["baseline_m", "target_distance_m"]
    assert (inputs.baseline_sigma_m, inputs.target_distance_sigma_m) == (0.005, 0.0005)
    primary, secondary = project.cameras
    assert primary is not None and secondary is None
    assert inputs.lens_known == {"primary": [0.003, 5.0]}
    kept = parse_plan(project.settings["plan"].encode(), "plan", str.encode)
    assert write_plan(kept) == write_plan(one)
    assert "2D" in planned_line(project.settings["plan_forecast"])
    app.switch_page("pages/plan.py").run()
    assert app.select_slider(key="plan_near_m").value == 9.0
    assert not app.error, messages(app)


def test_planned_lengths_are_not_taken_for_measured_ones(app: AppTest, home: Path) -> None:
    open_plan(app, {"plan.json": write_plan(plan(name="two boats"))})
    app.button(key="plan_start").click().run()
    project = Project.open(home, app.session_state["project_id"])
    files = {"primary": "primary.json", "secondary": "secondary.json"}
    for slot, name in {**files, "correspondences": "correspondences.csv"}.items():
        project.give({slot: (name, (SAMPLES / "field" / name).read_bytes())})  # type: ignore[dict-item]
    both = "the baseline (4.5 m) and the distance between the targets (0.9 m)"
    for page in ("data", "calibrate", "validate", "one_set"):
        go(app, page)
        assert both in messages(app) and "Planned, not yet measured" in messages(app)
        assert "the baseline as measured (planned: 4.5 m)" in messages(app)
        assert not [each for each in app.button if each.key == "run"]
    # One is measured, and the other is as planned.
    go(app, "data").number_input(key="baseline_m_value").set_value(4.47).run()
    assert project.inputs.planned == ["target_distance_m"]
    assert "Planned, not yet measured: the distance between" in messages(app).replace("*", "")
    go(app, "calibrate").button(key="take_planned").click().run()
    assert project.inputs.missing == []
    app.button(key="run").click().run()
    found = project.calibration
    assert found is not None
    assert (found.dataset.baseline_m, found.dataset.target_distance_m) == (4.47, 0.9)


def test_the_forecast_stands_beside_what_came_out(home: Path) -> None:
    project = placed(FULL, home)
    found = forecast(FIELD, rigs=16)
    project.keep_settings({"plan_forecast": found.to_json()})
    app = go(session(project), "calibrate")
    said = told(app, "caption")
    assert "The plan expected these median length errors: 2D" in said
    assert percent(found.estimate("refined", "median_error_3d").value) in said


def test_what_is_no_forecast_shows_no_line() -> None:
    assert planned_line(None) == "" and planned_line({"methods": {}}) == ""


def test_start_leads_to_it(home: Path) -> None:
    assert home.is_dir()
    started = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW).run()
    started.button(key="begin_plan").click().run()
    assert started.title[0].value == "Plan" and not started.exception
