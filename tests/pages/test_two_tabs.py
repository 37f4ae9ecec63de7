"""Two tabs with one project: neither takes back in silence what the other has done."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.frames.review import choose
from stereocal.projects.data_folder import default_home
from stereocal.projects.files import StoredFile
from stereocal.projects.home import remove
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, read_review
from tests.pages.stored_projects import FULL, go, placed, session, told


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Project:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    return placed(FULL, tmp_path)


def tabs(project: Project, page: str) -> tuple[AppTest, AppTest]:
    return go(session(project), page), go(session(project), page)


def sound(*apps: AppTest) -> None:
    for app in apps:
        assert not app.exception


def test_lengths(project: Project) -> None:
    a, b = tabs(project, "data")
    a.number_input(key="baseline_m_value").set_value(250.0).run()
    assert project.inputs.baseline_m == 2.5
    b.number_input(key="target_distance_m_value").set_value(0.8).run()
    assert (project.inputs.baseline_m, project.inputs.target_distance_m) == (2.5, 0.8)
    assert "Changed in another tab: baseline: 2.5 m" in told(b, "info")
    assert b.number_input(key="baseline_m_value").value == 250.0
    a.run()
    assert "Changed in another tab: distance between the targets: 0.8 m" in told(a, "info")
    a.run()
    assert "another tab" not in told(a, "info")
    sound(a, b)


def test_of_two_edits_of_one_length_the_last_holds_and_the_other_tab_is_told(
    project: Project,
) -> None:
    a, b = tabs(project, "data")
    a.number_input(key="baseline_m_value").set_value(250.0).run()
    b.number_input(key="baseline_m_value").set_value(260.0).run()
    assert project.inputs.baseline_m == 2.6
    assert "baseline: 2.5 m" in told(b, "info")
    a.run()
    assert "Changed in another tab: baseline: 2.6 m" in told(a, "info")
    assert a.number_input(key="baseline_m_value").value == 260.0
    sound(a, b)


def test_a_new_unit_does_not_bring_back_an_old_number(project: Project) -> None:
    a, b = tabs(project, "data")
    a.number_input(key="target_distance_m_value").set_value(0.7).run()
    b.selectbox(key="target_distance_m_unit").set_value("cm").run()
    assert project.inputs.target_distance_m == 0.7
    assert b.number_input(key="target_distance_m_value").value == 70.0
    assert "distance between the targets: 0.7 m" in told(b, "info")
    sound(a, b)


def test_camera_files(project: Project) -> None:
    a, b = tabs(project, "data")
    content = (placed_file(project, "primary")).replace(b"K", b"K")
    a.file_uploader(key="upload_primary").upload("new.json", content, "text/json").run()
    b.file_uploader(key="upload_secondary").upload(
        "other.json", placed_file(project, "secondary"), "text/json"
    ).run()
    labels = project.inputs.labels
    assert (labels["primary"], labels["secondary"]) == ("new.json", "other.json")
    assert "primary camera: new.json" in told(b, "info")
    sound(a, b)


def placed_file(project: Project, slot: str) -> bytes:
    return StoredFile(project.inputs.files[slot], project.database).read_bytes()


def test_settings_of_forms(project: Project) -> None:
    a, b = tabs(project, "calibrate")
    a.number_input(key="seed").set_value(5).run()
    b.number_input(key="delta").set_value(0.002).run()
    assert (project.settings["seed"], project.settings["delta"]) == (5, 0.002)
    assert b.number_input(key="seed").value == 5
    assert "Settings were changed in another tab" in told(b, "info")
    b.number_input(key="seed").set_value(6).run()
    a.run()
    assert a.number_input(key="seed").value == 6 and a.number_input(key="delta").value == 0.002
    assert "Settings were changed in another tab" in told(a, "info")
    sound(a, b)


def test_a_finished_validation_is_not_replaced_by_an_old_form(project: Project) -> None:
    a, b = tabs(project, "validate")
    a.slider(key="validate_runs").set_value(20).run()
    made = project.evaluation
    assert made is not None and made.settings.runs == 20
    b.run()
    kept = project.evaluation
    assert kept is not None and kept.settings == made.settings
    assert b.slider(key="validate_runs").value == 20
    sound(a, b)


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


class TestPairs:
    """The table of pairs. AppTest cannot edit it: what an edit does is done by its rows."""

    def test_a_rerun_does_not_bring_back_old_rows(self, project: Project) -> None:
        a, b = tabs(project, "data")
        store = ProjectPhotographs(project)
        rows = store.rows
        store.keep_rows([replace(rows[0], use=False), *rows[1:]])
        b.run()
        assert not store.rows[0].use
        assert "The pairs were changed in another tab" in told(b, "info")
        assert "5 of 6 pairs are used." in told(b, "caption")
        b.run()
        assert "another tab" not in told(b, "info") and not store.rows[0].use
        sound(a, b)

    def test_pairing_anew_waits_for_a_look(self, project: Project) -> None:
        a, b = tabs(project, "data")
        store = ProjectPhotographs(project)
        rows = store.rows
        store.keep_rows(rows[:5])
        b.button(key="pair_again").click().run()
        assert len(store.rows) == 5
        assert "The pairs were changed in another tab: look, and press again." in told(b, "error")
        b.run()
        b.button(key="pair_again").click().run()
        assert len(store.rows) == 6
        sound(a, b)


def test_photographs_of_another_tab_are_not_removed_unseen(project: Project) -> None:
    a, b = tabs(project, "data")
    store = ProjectPhotographs(project)
    store.add({"primary/left9.jpg": next(iter(store.photographs.values()))})
    b.button(key="no_photographs").click().run()
    assert len(store.photographs) == 13
    assert "Another tab has added photographs" in told(b, "error")
    b.run()
    b.button(key="no_photographs").click().run()
    assert not store.photographs
    a.run()
    sound(a, b)


def test_a_photograph_that_another_tab_replaced_is_told(project: Project) -> None:
    a, b = tabs(project, "data")
    store = ProjectPhotographs(project)
    name, path = next(iter(store.photographs.items()))
    assert "have changed" not in told(a, "warning")
    store.add({name: store.keep(name, path.read_bytes() + b"\n")})
    b.run()
    assert "The pairs or their photographs have changed since" in told(b, "warning")
    sound(a, b)


def one_frame(app: AppTest) -> AppTest:
    return app.segmented_control(key="frames_view").set_value("One frame").run()


def test_corrections_and_undo(project: Project) -> None:
    a, b = tabs(project, "data")
    store = ProjectPhotographs(project)
    change_review(store, lambda now: choose(now, 3, False))
    b.run()
    b.checkbox(key="use_frame_2").set_value(False).run()
    assert [frame.use for frame in read_review(store).frames] == [True, False, False, *[True] * 3]
    one_frame(b)
    change_review(store, lambda now: choose(now, 5, False))
    b.button(key="review_undo").click().run()
    assert not read_review(store).frame(5).use
    assert "Another tab has made a change since" in told(b, "warning")
    b.button(key="review_undo").click().run()
    assert read_review(store).frame(5).use and not read_review(store).frame(2).use
    sound(a, b)


def test_a_swap_is_not_done_twice(project: Project) -> None:
    a, b = tabs(project, "data")
    one_frame(a)
    b.run()
    a.button(key="swap_primary").click().run()
    store = ProjectPhotographs(project)
    swapped = read_review(store).frame(1)
    b.button(key="swap_primary").click().run()
    assert read_review(store).frame(1) == swapped
    assert "Another tab has moved A or B here" in told(b, "warning")
    sound(a, b)


def test_a_correction_made_during_a_search_outlives_it(project: Project) -> None:
    store = ProjectPhotographs(project)
    found = store.frames
    assert found is not None
    fresh = [replace(frame, reviewed=False) for frame in found]
    change_review(store, lambda now: choose(now, 4, False))
    store.keep_found(fresh, store.photographs)
    assert not read_review(store).frame(4).use
    assert len(read_review(store).edits) == 3


@pytest.mark.parametrize(
    ("page", "act"),
    [
        ("data", lambda app: app.number_input(key="baseline_m_value").set_value(300.0)),
        ("data", lambda app: app.checkbox(key="use_frame_2").set_value(False)),
        ("data", lambda app: app.button(key="pair_again").click()),
        ("data", lambda app: app.button(key="find_targets").click()),
        ("data", lambda app: app.button(key="look_2").click()),
        ("calibrate", lambda app: app.button(key="run").click()),
        ("calibrate", lambda app: app.number_input(key="seed").set_value(9)),
        ("validate", lambda app: app.slider(key="validate_runs").set_value(20)),
        ("cameras", lambda app: app.button(key="no_boards_primary").click()),
        ("cameras", lambda app: app.button(key="calibrate_primary").click()),
        ("data", lambda app: app.selectbox(key="baseline_m_known").set_value("Tape")),
        ("one_set", lambda app: app.number_input(key="refine_sigma_px").set_value(0.5)),
        ("apply", lambda app: app.number_input(key="apply_threshold").set_value(2.0)),
        ("apply", lambda app: app.button(key="apply_next").click()),
    ],
)
def test_a_project_removed_in_another_tab_is_said_and_does_not_come_back(
    page: str, act: Callable[[AppTest], AppTest], project: Project
) -> None:
    app = go(session(project), page)
    before = project.database.path.read_bytes()
    remove(default_home(), project.id)
    act(app).run()
    assert not app.exception
    assert "removed" in told(app, "error", "info", "warning")
    assert project.database.path.read_bytes() == before


def test_rename_and_duplicate(project: Project) -> None:
    a, b = tabs(project, "start")
    a.text_input(key=f"name_{project.id}").set_value("Swifts").run()
    b.button(key=f"duplicate_{project.id}").click().run()
    names = [item.value for item in b.text_input if str(item.key).startswith("name_")]
    assert "Swifts (copy)" in names and project.inputs.name == "Swifts"
    sound(a, b)
