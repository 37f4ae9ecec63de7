"""The menu: groups, states, the project's name, and the way to the next page."""

from __future__ import annotations

from pathlib import Path

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.projects.project import Project
from stereocal.ui.menu import RIG, SECTIONS, TITLES
from tests.pages.stored_projects import FULL, go, placed, session


@pytest.fixture
def project(home: Path) -> Project:
    return placed(FULL, home)


def states(app: AppTest) -> dict[str, str]:
    found = app.session_state["page_states"]
    return {name: state.mark for name, state in found.items()}


def test_every_file_of_pages_is_in_one_group() -> None:
    files = sorted(path.stem for path in (Path(__file__).parents[2] / "pages").glob("*.py"))
    assert sorted([*TITLES, RIG]) == files
    assert list(SECTIONS) == ["", "Before", "Calibrate", "Use"]


def test_the_project_is_named_and_renamed(project: Project) -> None:
    app = go(session(project), "validate")
    name = app.sidebar.text_input(key="project_name")
    assert name.value == project.inputs.name
    name.set_value("Meadow").run()
    assert project.inputs.name == "Meadow"
    assert app.sidebar.caption[0].value.startswith("Saved 20")
    assert not app.exception and not app.info
    assert go(app, "data").sidebar.text_input(key="project_name").value == "Meadow"


def test_the_states_follow_what_the_page_has_changed(project: Project) -> None:
    project.keep_settings({"validate_runs": 10})
    app = go(session(project), "calibrate")
    app.button(key="run").click().run()
    assert states(app)["calibrate"] == "done"
    app = go(app, "data")
    app.number_input(key="baseline_m_value").set_value(1.2345).run()
    assert states(app)["calibrate"] == "stale"
