"""Homes that cannot be made, that are full, or that can only be read: a sentence on every page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects import files as files_module
from stereocal.projects import home as home_module
from stereocal.projects.database import DiskFullError
from stereocal.projects.files import Store
from stereocal.projects.project import Project
from tests.pages.stored_projects import FULL, go, placed, session, told

REASON = "The disk is full."


@contextmanager
def broken(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Every change below the home fails."""

    def full(*_: object, **__: object) -> Store:
        raise DiskFullError(REASON)

    with monkeypatch.context() as patch:
        patch.setattr(Store, "transaction", full)
        patch.setattr(files_module, "create", full)
        patch.setattr(home_module, "copy_database", full)
        yield


def test_a_project_can_be_looked_at_and_every_change_is_refused_with_a_sentence(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = placed(FULL, home)
    app = session(project)
    for page in acts(project):  # what is computed of the project is on the disk before it breaks
        go(app, page)
    before = project.database.path.read_bytes()
    with broken(monkeypatch):
        for page, given in acts(project).items():
            assert not go(app, page).exception, page
            for act in given:
                act(app)
                app.run()
                assert not app.exception, (page, app.exception)
                assert REASON in told(app, "error", "warning"), (page, told(app))
    assert project.database.path.read_bytes() == before
    assert Project.open(home, project.id).calibration is not None


def acts(project: Project) -> dict[str, list[Callable[[AppTest], AppTest]]]:
    """What a person does on each page that changes something."""
    return {
        "start": [
            lambda app: app.text_input(key=f"name_{project.id}").set_value("New name"),
            lambda app: app.button(key=f"duplicate_{project.id}").click(),
        ],
        "data": [
            lambda app: app.number_input(key="baseline_m_value").set_value(300.0),
            lambda app: app.checkbox(key="use_frame_2").set_value(False),
            lambda app: app.button(key="no_photographs").click(),
        ],
        "calibrate": [
            lambda app: app.button(key="run").click(),
            lambda app: app.number_input(key="seed").set_value(9),
        ],
        "validate": [lambda app: app.slider(key="validate_runs").set_value(20)],
        "cameras": [
            lambda app: app.button(key="no_boards_primary").click(),
            lambda app: app.number_input(key="board_columns").set_value(9),
        ],
        "apply": [lambda app: app.number_input(key="apply_threshold").set_value(2.0)],
    }
