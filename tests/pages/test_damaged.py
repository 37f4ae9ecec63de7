"""Damaged projects, homes that are full, and unforeseen errors: a sentence on every page."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from streamlit import config
from streamlit.testing.v1 import AppTest

from stereocal.errors import StereocalError
from stereocal.formats.evaluation_files import Evaluation
from stereocal.projects import files as files_module
from stereocal.projects import home as home_module
from stereocal.projects import project as project_module
from stereocal.projects.database import DamagedError, DiskFullError
from stereocal.projects.files import Store
from stereocal.projects.home import recent_projects
from stereocal.projects.project import Project
from stereocal.system.latest import forget
from tests.pages.stored_projects import FULL, ROOT, dashboard, go, page_of, placed, told
from tests.refused import refused

SECRET = "/srv/secret/place"
RESULTS = {
    "calibration": ("calibrate", "calibrate again"),
    "frames": ("data", "find them again"),
    "boards_primary": ("cameras", "calibrate the lens again"),
    "lens_primary": ("cameras", "calibrate the lens again"),
    "applied": ("apply", "match and measure again"),
}


@pytest.mark.parametrize("kind", RESULTS)
def test_a_damaged_result_costs_itself_alone(kind: str, home: Path) -> None:
    project = placed(FULL, home)
    page, words = RESULTS[kind]
    app = page_of(project, "start")
    for content in (b"", b"{", b"\x93\x00{]\xff" * 40, b'{"x": [1]}'):
        project.database.keep_result(kind, content)
        go(app, page)
        assert not app.exception
        if kind != "applied":  # what is quick to compute is computed again
            assert words in told(app, "error", "warning") or "find the targets again" in told(app)
    assert "Complete: " in told(go(go(app, "start"), "data"))


def test_a_project_that_cannot_be_opened_is_listed_and_kept(home: Path) -> None:
    project = placed(FULL, home)
    path = project.database.path
    path.write_bytes(path.read_bytes()[:100] + bytes(3000) + path.read_bytes()[3100:])
    before = path.read_bytes()
    with refused("project's file", by=DamagedError):
        Project.open(home, project.id)
    assert "damaged" in told(page_of(project, "data"), "error")
    assert [one.damaged for one in recent_projects(home)] == [True]
    app = dashboard()
    assert "the file of this project is damaged" in told(app, "warning")
    assert not app.exception and path.read_bytes() == before
    app.button(key=f"remove_{project.id}").click().run()
    assert not app.exception and recent_projects(home) == []


def test_unforeseen_error_tells_its_kind_and_no_more(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = dashboard()
    assert not app.exception
    # What the file of settings says, as the server has it; tests of pages do not read it.
    assert 'showErrorDetails = "type"' in (ROOT / ".streamlit/config.toml").read_text()
    monkeypatch.setattr(config, "get_option", _as_on_the_server(config.get_option))

    def fails(*_args: object, **_kwargs: object) -> None:
        raise RuntimeError(f"{SECRET} is gone")

    monkeypatch.setattr("streamlit.title", fails)
    app.switch_page("pages/calibrate.py").run()
    (shown,) = app.exception
    proto = shown.proto
    assert proto.type == "RuntimeError"
    assert SECRET not in str(proto) and str(ROOT) not in str(proto) and str(home) not in str(proto)
    assert not proto.stack_trace


def _as_on_the_server(option: Callable[[str], Any]) -> Callable[[str], Any]:
    return lambda key: "type" if key == "client.showErrorDetails" else option(key)


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
    app = page_of(project)
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


def test_a_validation_that_could_not_be_read_once_is_there_again(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = placed(FULL, home)
    validation = project.evaluation
    assert validation is not None
    project.keep_evaluation(validation, of_calibration=True)
    forget()

    def unread(_content: bytes) -> Evaluation:
        raise StereocalError("not now")

    with monkeypatch.context() as once:
        once.setattr(project_module, "unpack_evaluation", unread)
        assert project.answer is not None and project.answer.evaluation is None
    assert project.answer is not None and project.answer.evaluation is not None
