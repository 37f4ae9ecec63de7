"""The Plan page, without a browser."""

import json
from functools import partial
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.field.planning.forecast import forecast
from stereocal.field.planning.through_window import forecast_through_window
from stereocal.formats.camera_file import write_camera
from stereocal.formats.plan_file import parse_plan, write_plan
from stereocal.projects.project import Project
from stereocal.verdict.in_words import percent
from tests.field.plans import FIELD, contents, plan
from tests.field.test_plan_through_window import TANK
from tests.pages.stored_projects import FULL, drop, go, messages, page_of, placed, project_of, told
from tests.rigs import known_rig


@pytest.fixture
def app(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """The Plan page, with forecasts of few rigs."""
    monkeypatch.setattr("stereocal.ui.plan.forecast", partial(forecast, rigs=16))
    return go(app, "plan")


def test_it_answers_at_once_without_a_project_and_follows_the_controls(
    app: AppTest, home: Path
) -> None:
    before = messages(app)
    assert "at 25 m" in before and "Limited by" in before
    app.number_input(key="plan_noise_px").set_value(0.4).run()
    assert not app.error and messages(app) != before
    app.select_slider(key="plan_far_m").set_value(20.0).run()
    assert "at 20 m" in messages(app)
    app.number_input(key="plan_needed_percent").set_value(0.01).run()
    assert "No, it does not reach what you need" in messages(app)
    app.number_input(key="plan_needed_percent").set_value(20.0).run()
    assert "Yes, it reaches what you need" in messages(app)
    # Values stay when the page is left.
    go(go(app, "start"), "plan")
    assert app.number_input(key="plan_noise_px").value == 0.4
    assert "at 20 m" in messages(app)
    assert "project_id" not in app.session_state
    assert not list(home.glob("projects/*.sqlite"))


def test_a_plan_is_opened_with_its_camera_files(app: AppTest) -> None:
    cameras = {"primary": "left.json", "secondary": contents()["cameras"]["secondary"]}
    content = json.dumps(contents(cameras=cameras, bar_m=1.25, frames=33)).encode()
    drop(app, {"plan.json": content}, "upload_plan")
    assert "names the camera file left.json" in messages(app)
    drop(app, {"plan.json": content, "left.json": write_camera(known_rig.PRIMARY)}, "upload_plan")
    assert not app.error
    assert app.number_input(key="plan_bar_m").value == 1.25
    assert app.select_slider(key="plan_frames").value == 33
    assert app.selectbox(key="plan_primary_camera").value == "A camera file"
    assert str(app.selectbox(key="plan_secondary_camera").value).startswith("IDT M5")


def test_a_window_is_stated_and_a_plan_with_one_is_opened_and_simulated(
    app: AppTest, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = partial(forecast_through_window, days=2)
    monkeypatch.setattr("stereocal.ui.plan.forecast_through_window", few)
    drop(app, {"plan.json": write_plan(TANK)}, "upload_plan")
    assert not app.error
    assert app.number_input(key="plan_window_m").value == 0.4
    assert app.number_input(key="plan_window_mm").value == 10.0
    app.button(key="plan_simulate").click().run()
    assert not app.exception
    assert "simulated field days)" in messages(app)
    app.number_input(key="plan_medium").set_value(1.343).run()
    assert "simulated field days)" not in messages(app)
    assert app.button(key="plan_simulate")  # of another plan
    app.toggle(key="plan_window").set_value(False).run()
    assert "Limited by" in messages(app)


def test_what_was_simulated_is_there_when_the_page_is_opened_again(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    few = partial(forecast_through_window, days=2)
    monkeypatch.setattr("stereocal.ui.plan.forecast_through_window", few)
    project = Project.create(home)
    app = page_of(project, "plan")
    drop(app, {"plan.json": write_plan(TANK)}, "upload_plan")
    app.button(key="plan_simulate").click().run()
    again = page_of(project, "plan")
    assert not again.exception and "simulated field days)" in messages(again)


def test_three_plans_side_by_side(app: AppTest) -> None:
    for name, noise in (("first", 0.3), ("second", 0.5)):
        app.text_input(key="plan_name").set_value(name)
        app.number_input(key="plan_noise_px").set_value(noise).run()
        app.button(key="plan_keep").click().run()
    app.text_input(key="plan_name").set_value("third")
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
    one = plan(name="two boats", stated_primary=known_rig.PRIMARY, near_m=9.0, needed=0.02)
    drop(app, {"plan.json": write_plan(one)}, "upload_plan")
    app.button(key="plan_start").click().run()
    assert not app.error and app.title[0].value == "Data"
    project = project_of(app, home)
    inputs = project.inputs
    assert inputs.name == "two boats"
    assert (inputs.baseline_m, inputs.target_distance_m) == pytest.approx((4.5, 0.9))
    assert inputs.planned == ["baseline_m", "target_distance_m"]
    assert (inputs.baseline_sigma_m, inputs.target_distance_sigma_m) == (0.005, 0.0005)
    primary, secondary = project.cameras
    assert primary is not None and secondary is None
    assert inputs.lens_known == {"primary": (0.003, 5.0)}
    kept = parse_plan(project.settings["plan"].encode(), "plan", str.encode)
    assert write_plan(kept) == write_plan(one)
    assert set(project.settings["plan_forecast"]["methods"]) >= {"2d", "3d", "refined"}
    app.switch_page("pages/plan.py").run()
    assert app.select_slider(key="plan_near_m").value == 9.0
    assert not app.error, messages(app)


def test_the_forecast_stands_beside_what_came_out_and_a_damaged_pose_is_passed_over(
    home: Path,
) -> None:
    project = placed(FULL, home)
    found = forecast(FIELD, rigs=16)
    project.keep_settings({"plan_forecast": found.to_json(), "plan_stated_pose": {}})
    app = page_of(project, "calibrate")
    said = told(app, "caption")
    assert "The plan expected 95 % of lengths within: 2D" in said
    assert percent(found.estimate("refined", "p95_error_3d").value) in said
    assert go(app, "plan").select_slider(key="plan_baseline_m").value == 4.5
    assert not app.exception


def test_a_camera_file_without_an_image_size_is_asked_for_it(app: AppTest) -> None:
    content = json.dumps({"mtx": known_rig.PRIMARY.K.tolist(), "dist": [0.1, -0.2, 0.0, 0.0, 0.0]})
    app.selectbox(key="plan_primary_camera").set_value("A camera file").run()
    app.file_uploader(key="upload_plan_primary").upload("left.json", content.encode()).run()
    assert "left.json: the file does not state the size of the images" in messages(app)
    app.button(key="use_rest").click().run()  # without an answer it is asked again
    for side, pixels in (("width", 1600), ("height", 1200)):
        app.number_input(key=f"refused_{side}").set_value(pixels)
    app.button(key="use_rest").click().run()
    assert not app.error and "In use: 1600 x 1200 px" in told(app, "caption")
