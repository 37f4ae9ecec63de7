"""The page One set or two, without a browser, and what Data states for its refined set."""

from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.figures.one_set import FIXED
from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.refined.unknowns import DEFAULT_FOCAL, baseline_sigma_m, lens_prior
from stereocal.rig.dataset import Dataset
from stereocal.system.latest import Latest
from stereocal.ui import one_set as page
from stereocal.ui import refined
from stereocal.ui.refined import refine_settings
from stereocal.verdict.forecast import Outlook, outlook_of
from stereocal.workflow import calibrate, conclusions_of_seeds
from tests.pages.stored_projects import (
    FULL,
    again,
    messages,
    pictured,
    placed,
    project_of,
    told,
    wait_until,
)
from tests.pages.test_pages import open_sample, states


def one_set(app: AppTest) -> AppTest:
    return app.switch_page("pages/one_set.py").run()


def few_runs(app: AppTest, home: Path) -> Project:
    """The project, with a validation that is quick where its figures do not matter."""
    project = project_of(app, home)
    project.keep_settings({"validate_runs": 10})
    return project


def parameters(app: AppTest) -> Any:
    """The table of the refined set."""
    app.segmented_control(key="one_set_view").set_value("The refined set").run()
    return app.table[-1].value


def test_answers_and_follows_the_form(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    one_set(app)
    assert "One set does both jobs here" in messages(app)
    assert "Nothing that was typed or measured disagrees" not in messages(app)
    assert "go unnoticed" in messages(app)
    assert "errors on held-out frames are" in told(app)
    assert parameters(app).loc["Baseline (m)", "Standard error"] == "± 0.0052"
    app.switch_page("pages/data.py").run()
    for which in ("primary", "secondary"):
        app.selectbox(key=f"lens_{which}_known").set_value("Typed").run()
        app.number_input(key=f"lens_{which}_focal_percent").set_value(0.0)
        app.number_input(key=f"lens_{which}_centre_px").set_value(0.0).run()
    few_runs(app, home)
    one_set(app)
    row = "Focal length fx, primary camera (px)"
    assert parameters(app).loc[row, "Standard error"] == "held"
    assert project.evaluation is None  # the page needs no validation


def test_the_slider_moves_along_the_curve_and_the_distortion_is_estimated(
    app: AppTest, home: Path
) -> None:
    project = few_runs(open_sample(app), home)
    one_set(app)
    seen = {told(app)}
    for along in (0, 100):
        app.slider(key="along").set_value(along).run()
        seen.add(told(app))
    app.segmented_control(key="curve").set_value(FIXED).run()
    assert len({*seen, told(app)}) == 4
    assert project.settings["along"] == 100
    # Residuals by place tell noise from a lens.
    app.segmented_control(key="one_set_view").set_value("Residuals by place").run()
    assert "they accuse no lens" in pictured(app)
    before, row = parameters(app), "Focal length fx, secondary camera (px)"
    app.multiselect(key="free_distortion").set_value(["secondary"]).run()
    assert project.settings["free_distortion"] == ["secondary"]
    assert str(app.table[-1].value.loc[row]) != str(before.loc[row])


def test_other_seeds_are_tried_beside_the_page_and_once(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once also where the caches are full of other projects, so that each look reads it anew."""
    tried = []

    def conclusions(calibration: Calibration, outlook: Outlook) -> str:
        tried.append(outlook)
        return conclusions_of_seeds(calibration, outlook, seeds=(1,)) or "Another seed, the same."

    monkeypatch.setattr(page, "conclusions_of_seeds", conclusions)
    monkeypatch.setattr(page, "_SEEDS", Latest(500))
    monkeypatch.setattr(refined, "_made", lambda: Latest(0))
    monkeypatch.setattr(refined, "outlook_for", outlook_of)
    few_runs(open_sample(app), home)
    one_set(app)
    wait_until(lambda: "Trying other seeds" not in told(app.run()))
    assert "Another seed" in messages(app) and len(tried) == 1


def test_the_refined_set_can_serve_a_purpose(app: AppTest, home: Path) -> None:
    project = few_runs(open_sample(app), home)
    dataset = project.dataset
    assert dataset is not None
    project.keep_calibration(calibrate(dataset), project.inputs)
    one_set(app)
    assert app.toggle(key="refined_2d").value and app.toggle(key="refined_3d").value  # recommended
    app.toggle(key="refined_3d").set_value(False).run()
    assert Project.open(home, project.id).settings["apply_measuring"] == "3d"
    app.switch_page("pages/apply.py").run()
    used = [app.selectbox(key=f"apply_{use}").value for use in ("matching", "measuring")]
    assert used == ["refined", "3d"]
    app.selectbox(key="apply_matching").set_value("2d").run()
    one_set(app)
    assert not app.toggle(key="refined_2d").value and not app.toggle(key="refined_3d").value


def test_what_is_stale_is_said_with_the_button_that_mends_it(pressed: AppTest, home: Path) -> None:
    """A slider of Validate: what is shown stays as it was made, and is renewed where it stands."""
    app, project = pressed, project_of(pressed, home)
    before = project.calibration_digest
    project.keep_settings({"acceptance": 0.3})
    changed = "Changed since this result: acceptance ratio (0.2, now 0.3)."
    for name in ("calibrate", "one_set", "apply"):
        app.switch_page(f"pages/{name}.py").run()
        assert changed in messages(app)
        renewing = app.button(key="run")
        assert (renewing.label, renewing.proto.type) == ("Calibrate again", "primary")
    one_set(app)
    assert "Use the refined set for both" in messages(app)
    assert not app.get("download_button")[0].proto.disabled
    app.button(key="run").click().run()
    assert changed not in messages(app) and not [b for b in app.button if b.key == "run"]
    assert project.calibration_digest != before and project.calibration_evaluation is not None
    assert states(app)["one_set"] == "done"


def read(project: Project) -> Dataset:
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
    prior = lens_prior(dataset.secondary, settings.secondary)
    assert (prior.focal, prior.centre_px) == pytest.approx((0.004, 6.0))
    assert lens_prior(dataset.primary, settings.primary).focal == DEFAULT_FOCAL

    tab = again(app, "data")
    assert tab.selectbox(key="baseline_m_known").value == "Typed"
    assert tab.number_input(key="baseline_m_sigma_mm").value == 3.5
    assert tab.number_input(key="lens_secondary_focal_percent").value == 0.4
    assert tab.number_input(key="lens_secondary_centre_px").value == 6.0
    assert tab.selectbox(key="lens_primary_known").value == "Not stated"


def test_freed_lenses_are_the_same_setting_in_any_order(home: Path) -> None:
    project = placed(FULL, home)
    project.keep_settings({"free_distortion": ["secondary", "primary"]})
    settings = refine_settings(project, read(project))
    assert settings.free_distortion == ("primary", "secondary")
