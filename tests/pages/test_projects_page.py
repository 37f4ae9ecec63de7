"""The list of projects on the Start page."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.project import Project
from stereocal.store.carry import pack_project
from stereocal.store.projects import recent_projects
from tests.pages.test_pages import app as app
from tests.pages.test_pages import home as home
from tests.pages.test_pages import messages, open_sample, project_of


def start(app: AppTest) -> AppTest:
    return app.switch_page("pages/start.py").run()


def keys(app: AppTest) -> set[str]:
    return {str(button.key) for button in app.button}


def test_an_empty_server_shows_no_list_and_says_what_is_kept(app: AppTest, home: Path) -> None:
    assert [header.value for header in app.header] == ["What to bring"]
    text = " ".join(str(item.value) for item in app.markdown)
    assert str(home) in text
    assert "30 days" in text


def test_rename_duplicate_remove_and_undo(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    start(app).text_input(key=f"name_{project.id}").set_value(" Swifts <i>2026</i> ").run()
    assert project.inputs.name == "Swifts <i>2026</i>"
    app.button(key=f"duplicate_{project.id}").click().run()
    listed = recent_projects(home)
    assert [one.name for one in listed] == ["Swifts <i>2026</i> (copy)", "Swifts <i>2026</i>"]
    app.button(key=f"remove_{listed[0].id}").click().run()
    assert f"open_{listed[0].id}" not in keys(app)
    assert "was removed" in messages(app)
    app.button(key="undo_remove").click().run()
    assert {one.id for one in recent_projects(home)} == {one.id for one in listed}
    assert "undo_remove" not in keys(app)


def test_open_goes_to_the_data_of_that_project(app: AppTest, home: Path) -> None:
    first = project_of(open_sample(app), home)
    second = project_of(open_sample(start(app)), home)
    assert first.id != second.id
    first.give({}, baseline_m=7.25)
    start(app).button(key=f"open_{first.id}").click().run()
    assert app.session_state["project_id"] == first.id
    assert app.number_input(key="baseline_m_value").value == 7.25


def test_what_went_meanwhile_is_said(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    start(app)
    for path in project.folder.iterdir():
        if path.is_file():
            path.unlink()
    app.button(key=f"duplicate_{project.id}").click().run()
    assert "no project at this address" in messages(app)


def test_a_shared_server_lists_nothing(
    app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = project_of(open_sample(app), home)
    monkeypatch.setenv("STEREOCAL_SHARED", "1")
    monkeypatch.setenv("STEREOCAL_KEEP_DAYS", "90")
    assert not any(project.id in key for key in keys(start(app)))
    text = " ".join(str(item.value) for item in app.markdown)
    assert "90 days" in text
    assert str(home) not in text
    assert Project.open(home, project.id).dataset is not None


def test_a_project_goes_out_as_a_zip_and_comes_in_again(
    app: AppTest, home: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    project = project_of(open_sample(app), home)
    project.give({}, baseline_m=6.5)
    zipped = tmp_path_factory.mktemp("elsewhere") / "field.zip"
    pack_project(project, zipped)
    start(app).button(key="pack").click().run()
    assert not list(project.folder.glob(".packed*"))
    app.file_uploader(key="upload_project").upload(
        "field.zip", zipped.read_bytes(), "application/zip"
    ).run()
    opened = project_of(app, home)
    assert opened.id != project.id
    assert opened.inputs.baseline_m == 6.5


def test_a_zip_without_a_project_is_said(app: AppTest, home: Path) -> None:
    app.file_uploader(key="upload_project").upload("odd.zip", b"PK", "application/zip").run()
    assert "odd.zip" in messages(app)
    assert not (home / "projects").exists() or not list((home / "projects").iterdir())
