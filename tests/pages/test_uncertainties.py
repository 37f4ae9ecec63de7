"""How well lengths and lenses are known: stated on Data, kept, and used by every method."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.project import Project
from stereocal.refined.unknowns import DEFAULT_FOCAL, baseline_sigma_m, lens_prior
from stereocal.rig.dataset import Dataset
from stereocal.ui.refined import refine_settings
from tests.pages.stored_projects import FULL, again, placed, project_of
from tests.pages.test_pages import open_sample

ROOT = Path(__file__).parents[2]


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
