"""Two tabs with one project: the last change holds, and a tab shows what is stored; what was set
stands on every form of a new tab, and a draw writes nothing."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.frames.review import use_frame
from stereocal.projects.home import remove
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, read_review
from stereocal.projects.server_settings import default_home
from tests.pages.stored_projects import FULL, ended, go, page_of, placed, told


@pytest.fixture
def project(home: Path) -> Project:
    return placed(FULL, home)


def tabs(project: Project, page: str) -> tuple[AppTest, AppTest]:
    return page_of(project, page), page_of(project, page)


def sound(*apps: AppTest) -> None:
    for app in apps:
        assert not app.exception


def test_a_tab_shows_what_another_has_changed(project: Project) -> None:
    a, b = tabs(project, "data")
    a.number_input(key="baseline_m_value").set_value(250.0).run()
    b.number_input(key="target_distance_m_value").set_value(0.8).run()
    assert (project.inputs.baseline_m, project.inputs.target_distance_m) == (2.5, 0.8)
    assert b.number_input(key="baseline_m_value").value == 250.0
    a.run()
    assert a.number_input(key="target_distance_m_value").value == 0.8
    # Of two edits of one value the last holds.
    b.number_input(key="baseline_m_value").set_value(260.0).run()
    assert project.inputs.baseline_m == 2.6
    a.run()
    assert a.number_input(key="baseline_m_value").value == 260.0
    # Settings of forms too.
    go(a, "calibrate").number_input(key="seed").set_value(5).run()
    go(b, "calibrate").number_input(key="delta").set_value(0.002).run()
    assert (project.settings["seed"], project.settings["delta"]) == (5, 0.002)
    assert b.number_input(key="seed").value == 5
    a.run()
    assert a.number_input(key="delta").value == 0.002
    sound(a, b)


def test_a_name_typed_before_the_click_on_another_project_is_kept(
    project: Project, tmp_path: Path
) -> None:
    """Streamlit runs both callbacks, in either order."""
    other = placed(FULL, tmp_path)
    app = page_of(project, "start")
    app.button(key=f"open_{other.id}").click()
    app.text_input(key="project_name").set_value("Bats")
    app.run()
    sound(app)
    assert app.query_params["project"] == other.id
    assert project.inputs.name == "Bats" != other.inputs.name


def test_the_last_finished_calibration_holds_and_says_what_it_was_made_with(
    project: Project,
) -> None:
    a, b = tabs(project, "calibrate")
    a.number_input(key="seed").set_value(3).run()
    a.button(key="run").click().run()
    b.button(key="run").click().run()
    kept = project.calibration
    assert kept is not None and kept.settings.search.seed == 3  # told to b before it calibrated
    sound(a, b)


def test_a_rerun_does_not_bring_back_old_pairs(project: Project) -> None:
    """AppTest cannot edit the table: what an edit does is done by its rows."""
    a, b = tabs(project, "data")
    store = ProjectPhotographs(project)
    rows = store.rows
    store.keep_rows([replace(rows[0], use=False), *rows[1:]])
    b.run()
    assert not store.rows[0].use
    assert "5 of 6 pairs are used." in told(b, "caption")
    sound(a, b)


def test_corrections_and_undo(project: Project) -> None:
    tab = page_of(project, "data")
    store = ProjectPhotographs(project)
    change_review(store, lambda now: use_frame(now, 3, False))
    tab.run()
    tab.checkbox(key="use_frame_2").set_value(False).run()
    assert [frame.use for frame in read_review(store).frames] == [True, False, False, *[True] * 3]
    tab.segmented_control(key="frames_view").set_value("One frame").run()
    change_review(store, lambda now: use_frame(now, 5, False))
    tab.button(key="review_u").click().run()
    assert read_review(store).frame(5).use and not read_review(store).frame(2).use
    sound(tab)


@pytest.mark.parametrize(
    ("page", "act"),
    [
        ("data", lambda app: app.number_input(key="baseline_m_value").set_value(300.0)),
        ("data", lambda app: app.button(key="find_targets").click()),
        ("calibrate", lambda app: app.button(key="run").click()),
        ("validate", lambda app: app.slider(key="validate_runs").set_value(20)),
        ("cameras", lambda app: app.button(key="calibrate_primary").click()),
        ("apply", lambda app: app.button(key="apply_next").click()),
    ],
)
def test_a_project_removed_in_another_tab_is_said_and_does_not_come_back(
    page: str, act: Callable[[AppTest], AppTest], project: Project
) -> None:
    app = page_of(project, page)
    before = project.database.path.read_bytes()
    remove(default_home(), project.id)
    act(app).run()
    assert not app.exception
    assert "removed" in told(app, "error", "info", "warning")
    assert project.database.path.read_bytes() == before


SET: dict[str, dict[str, Any]] = {
    "data": {
        "baseline_m_unit": "cm",
        "frames_view": "One frame",
        "review_target": "B",
        "baseline_m_known": "Tape",
    },
    "plan": {
        "plan_name": "pond",
        "plan_alike": False,
        "plan_baseline_m": 5.0,
        "plan_near_m": 9.0,
        "plan_frames": 30,
    },
    "cameras": {
        "board_kind": "ChArUco",
        "board_columns": 9,
        "board_square_mm": 25.0,
        "lens_seed": 4,
        "lens_fix_k3": True,
    },
    "calibrate": {
        "calibration_frames": 5,
        "delta": 0.002,
        "delta_min": 3e-6,
        "essential": "linear",
        "view": "Stated and estimated",
        "rig_method": "2d",
        "refine_sigma_px": 0.3,
    },
    "validate": {
        "delta": 0.002,
        "validate_runs": 20,
        "validate_frames": 3,
        "bin_width": 0.2,
        "with_refined": False,
        "columns": "Residual",
    },
    "apply": {
        "apply_matching": "3d",
        "apply_only_depths": True,
        "apply_near": 1.5,
        "apply_threshold": 2.5,
        "apply_view": "Threshold and depths",
    },
    "check": {"check_turn_deg": 0.2, "check_baseline_percent": 0.5},
}
"""Of each page, by the key of the widget; none is the usual value."""
STATED: dict[str, Any] = {
    "baseline_sigma_m": 0.005,
    "target_distance_sigma_m": 0.0007,
    "lens_known": {"primary": [0.004, 6.0]},
}
"""What the Data page's fields of how well things are known write."""
STATED_SHOWN = {
    "review_frame": 5,
    "target_distance_m_known": "Typed",
    "target_distance_m_sigma_mm": 0.7,
    "lens_primary_known": "Typed",
    "lens_primary_focal_percent": 0.4,
    "lens_primary_centre_px": 6.0,
    "lens_secondary_known": "Not stated",
}
KINDS = ("number_input", "segmented_control", "select_slider", "selectbox", "slider", "text_input")


@pytest.mark.parametrize("name", SET)
def test_what_was_set_stands_on_its_page(name: str, home: Path) -> None:
    project = placed(FULL, home)
    for values in SET.values():
        project.keep_settings(values)
    project.keep_settings({"frame": 5})  # one value for the frame fields of all pages
    project.give({}, **STATED)
    stored = project.settings, project.inputs
    app = page_of(project, name)
    if name == "validate":
        assert ended(project, "evaluation").state == "done"
        app.run()
    assert not app.exception and not app.error
    wanted = SET[name] | (STATED_SHOWN if name == "data" else {})
    widgets = [each for kind in (*KINDS, "toggle") for each in getattr(app, kind)]
    # The keys of sliders end in their ends.
    shown = {re.sub(r"_\d+_\d+$", "", str(each.key)): each.value for each in widgets}
    assert {key: shown.get(key) for key in wanted} == wanted
    assert (project.settings, project.inputs) == stored
