"""The looks of Calibrate at the refined set, and what Data and the settings state for it."""

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.fit.least_squares.unknowns import DEFAULT_FOCAL, baseline_sigma_m, lenses_of
from stereocal.projects.packed import packed_table
from stereocal.projects.project import Project
from stereocal.rig.pair import Pair
from stereocal.ui.forms import refine_settings
from tests.pages.stored_projects import (
    FEW,
    FULL,
    again,
    go,
    look_at,
    messages,
    pictured,
    placed,
    project_of,
    told,
)
from tests.pages.test_pages import open_sample, states


def look(app: AppTest, name: str) -> AppTest:
    return look_at(app, name)


def test_inputs_are_tested_and_the_settings_are_followed(pressed: AppTest, home: Path) -> None:
    app, project = pressed, project_of(pressed, home)
    project.keep_settings(FEW)
    assert "What disagrees" not in told(app)
    look(app, "Stated and estimated")
    assert "go unnoticed" in messages(app)
    assert "Baseline" in list(app.table[0].value.index)
    row = "Focal length fx, primary camera (px)"
    table = app.table[-1].value
    assert str(table.loc[row, "Standard error"]).startswith("±")
    app.switch_page("pages/data.py").run()
    for which in ("primary", "secondary"):
        app.selectbox(key=f"lens_{which}_known").set_value("Typed").run()
        app.number_input(key=f"lens_{which}_focal_percent").set_value(0.0)
        app.number_input(key=f"lens_{which}_centre_px").set_value(0.0).run()
    go(app, "calibrate").multiselect(key="free_distortion").set_value(["secondary"]).run()
    app.button(key="run").click().run()
    table = look(app, "Stated and estimated").table[-1].value
    assert table.loc[row, "Standard error"] == "held"
    calibration = project.calibration
    assert calibration is not None and calibration.refined is not None
    assert calibration.refined.settings.free_distortion == ("secondary",)


def test_the_looks_are_computed_from_the_stored_result(pressed: AppTest, home: Path) -> None:
    run = project_of(pressed, home).run
    assert run is not None and run.forecast is not None and run.forecast.check is not None
    look(pressed, "Stated and estimated")
    for sentence in (run.forecast.verdict.figures, run.forecast.check.text, run.advice):
        assert sentence and sentence in told(pressed, "caption")
    look(pressed, "Residuals by place")
    assert "they accuse no lens" in pictured(pressed)
    look(pressed, "How accurate, where")
    assert "(median)" in pictured(pressed)


def test_a_project_with_a_look_that_is_gone_opens(pressed: AppTest, home: Path) -> None:
    project_of(pressed, home).keep_settings({"view": "Parameters", "along": 100})
    tab = again(pressed, "calibrate")
    assert not tab.exception
    assert tab.segmented_control(key="view").value == "Errors by frame"


def test_what_is_stale_is_said_with_the_button_that_mends_it(pressed: AppTest, home: Path) -> None:
    """A slider of Validate: what is shown stays as it was made, and is renewed where it stands."""
    app, project = pressed, project_of(pressed, home)
    before = project.calibration_digest
    project.keep_settings({"acceptance": 0.3})
    changed = "Changed since this result: acceptance ratio (0.2, now 0.3)."
    for name in ("calibrate", "apply"):
        app.switch_page(f"pages/{name}.py").run()
        assert changed in messages(app)
        renewing = app.button(key="run")
        assert (renewing.label, renewing.proto.type) == ("Calibrate again", "primary")
    project.keep_settings(FEW)
    app.button(key="run").click().run()
    assert changed not in messages(app) and not [b for b in app.button if b.key == "run"]
    assert project.calibration_digest != before and project.calibration_evaluation is not None
    assert states(app)["calibrate"] == "done"


def read(project: Project) -> Pair:
    dataset = project.dataset
    assert dataset is not None
    return dataset


def choose(app: AppTest, key: str, option: str) -> None:
    app.selectbox(key=f"{key}_known").set_value(option).run()


def test_typed_numbers_stand_after_f5_and_reach_the_refined_method(
    app: AppTest, home: Path
) -> None:
    project = project_of(open_sample(app), home)
    choose(app, "baseline_m", "Typed")
    assert read(project).baseline_sigma_m is None  # the field is empty yet
    app.number_input(key="baseline_m_sigma_mm").set_value(3.5).run()
    choose(app, "lens_secondary", "Typed")
    app.number_input(key="lens_secondary_focal_percent").set_value(0.4).run()
    assert read(project).secondary.uncertainty is None  # both numbers, or none
    app.number_input(key="lens_secondary_centre_px").set_value(6.0).run()
    dataset = read(project)
    settings = refine_settings(project, dataset)
    assert baseline_sigma_m(dataset, settings) == pytest.approx(0.0035)
    prior = lenses_of(dataset.recording, settings)["secondary"]
    assert (prior.focal, prior.centre_px) == pytest.approx((0.004, 6.0))
    assert lenses_of(dataset.recording, settings)["primary"].focal == DEFAULT_FOCAL

    tab = again(app, "data")
    assert tab.selectbox(key="baseline_m_known").value == "Typed"
    assert tab.number_input(key="baseline_m_sigma_mm").value == 3.5
    assert tab.number_input(key="lens_secondary_focal_percent").value == 0.4
    assert tab.number_input(key="lens_secondary_centre_px").value == 6.0
    assert tab.selectbox(key="lens_primary_known").value == "Not stated"


def test_a_printed_length_is_known_to_a_share_of_it(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    choose(app, "target_distance_m", "Caliper")
    assert read(project).target_distance_sigma_m == pytest.approx(0.0001)
    choose(app, "target_distance_m", "Printer")
    assert read(project).target_distance_sigma_m == pytest.approx(0.003 * 0.9)
    app.number_input(key="target_distance_m_value").set_value(0.5).run()
    assert read(project).target_distance_sigma_m == pytest.approx(0.003 * 0.5)
    assert app.selectbox(key="target_distance_m_known").value == "Printer"
    choose(app, "target_distance_m", "Not stated")
    assert read(project).target_distance_sigma_m is None
    # Another data set, which states nothing, is not as printed.
    choose(app, "target_distance_m", "Printer")
    project.give({}, target_distance_m=0.7, target_distance_sigma_m=None)
    app.run()
    assert app.selectbox(key="target_distance_m_known").value == "Not stated"


def test_points_that_are_too_few_are_not_green_and_lead_nowhere(app: AppTest, home: Path) -> None:
    """Two pairs in one frame, and four in two: five are needed."""
    project = project_of(open_sample(app), home)
    assert app.button(key="next") and len(app.success)
    table = packed_table(read(project).correspondences)
    head, *rows = table.splitlines(keepends=True)
    for few in (2, 4):
        project.give({"correspondences": ("few.csv", head + b"".join(rows[:few]))})
        app.switch_page("pages/data.py").run()
        assert f"{few} pairs" in " ".join(str(each.value) for each in app.warning)
        assert not len(app.success) and "next" not in [each.key for each in app.button]
        assert states(app)["data"] == "missing"


def test_freed_lenses_are_the_same_setting_in_any_order(home: Path) -> None:
    project = placed(FULL, home)
    project.keep_settings({"free_distortion": ["secondary", "primary"]})
    settings = refine_settings(project, read(project))
    assert settings.free_distortion == ("primary", "secondary")
