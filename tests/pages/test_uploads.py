"""A click while an upload is being taken ends the script; the next run takes the upload."""

from __future__ import annotations

import pkgutil
from pathlib import Path

import pytest
import streamlit as st
from streamlit.testing.v1 import AppTest

from stereocal.formats.dataset_files import pack_dataset, read_dataset
from stereocal.projects import jobs as stored_jobs
from stereocal.projects.application import ProjectApplication
from stereocal.projects.archive import pack_project
from stereocal.projects.home import recent_projects
from tests.pages.stored_projects import messages, project_of
from tests.pages.test_pages import FIELD, give_zip, open_sample, zipped
from tests.pages.waiting import wait_until


def click_meanwhile(monkeypatch: pytest.MonkeyPatch, function: str) -> list[object]:
    """The first call of a function ends in the exception that a click raises; lists the calls."""
    original = pkgutil.resolve_name(function)
    calls: list[object] = []

    def interrupted(*given: object, **named: object) -> object:
        calls.append(given)
        if len(calls) == 1:
            st.rerun()
        return original(*given, **named)

    monkeypatch.setattr(function, interrupted)
    return calls


def upload(app: AppTest, key: str, name: str, content: bytes, calls: list[object]) -> None:
    """Upload a file; it is taken in the run after the click, and once."""
    app.file_uploader(key=key).upload(name, content).run()
    assert len(calls) == 2
    app.run()
    assert len(calls) == 2


@pytest.mark.parametrize("place", ["give_dataset", "unzip"])
def test_data_set(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch, place: str) -> None:
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("A zip").run()
    calls = click_meanwhile(monkeypatch, f"stereocal.ui.intake.{place}")
    upload(app, "upload_zip", "rig.zip", zipped(pack_dataset(read_dataset(FIELD))), calls)
    assert project_of(app, home).dataset is not None


def test_a_search_for_targets_of_the_data_set_before_is_stopped(app: AppTest, home: Path) -> None:
    project = project_of(open_sample(app), home)
    searching = stored_jobs.begin(project.database, "photographs", ["photographs"], {})
    assert searching is not None and searching.progress(0, 1, 9)
    give_zip(app, pack_dataset(read_dataset(FIELD)))
    assert not app.exception
    wait_until(lambda: not searching.progress(0, 2, 9))
    searching.end()


def test_refusal_is_said(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> None:
    app.switch_page("pages/data.py").run()
    app.segmented_control(key="data_how").set_value("A zip").run()
    calls = click_meanwhile(monkeypatch, "stereocal.ui.messages.refuse")
    upload(app, "upload_zip", "bad.zip", b"no zip", calls)
    assert "not a valid zip" in messages(app)


def test_points(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = project_of(open_sample(app), home)
    app.switch_page("pages/apply.py").run()
    app.selectbox(key="apply_points").set_value("Two point files").run()
    calls = click_meanwhile(
        monkeypatch, "stereocal.projects.application.ProjectApplication.offer_points"
    )
    upload(app, "upload_points_primary", "p.csv", b"frame,u,v\n0,1,2\n", calls)
    assert ProjectApplication(project).points("primary") is not None


def test_further_data_set(app: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    project = project_of(open_sample(app), home)
    app.switch_page("pages/validate.py").run()
    calls = click_meanwhile(monkeypatch, "stereocal.projects.project.Project.add_dataset")
    upload(app, "upload_more", "rig.zip", zipped(pack_dataset(read_dataset(FIELD))), calls)
    assert len(project.more_datasets) == 1


def test_project_is_unpacked_once(
    app: AppTest,
    home: Path,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    project = project_of(open_sample(app), home)
    packed = tmp_path_factory.mktemp("elsewhere") / "field.zip"
    pack_project(project, packed)
    app.switch_page("pages/start.py").run()
    calls = click_meanwhile(monkeypatch, "stereocal.ui.projects.open_project")
    upload(app, "upload_project", "field.zip", packed.read_bytes(), calls)
    assert {one.id for one in recent_projects(home)} == {project.id, project_of(app, home).id}
    assert project_of(app, home).id != project.id
