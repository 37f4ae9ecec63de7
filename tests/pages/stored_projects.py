"""A project with something of everything, put into a home; and a look at every page of one."""

from __future__ import annotations

from pathlib import Path

from streamlit.testing.v1 import AppTest

from stereocal.projects.archive import unpack_project
from stereocal.projects.project import Project

ROOT = Path(__file__).parents[2]
FULL = ROOT / "tests" / "projects" / "full.zip"
"""6 pairs of photographs, targets, 2 edits, a calibration, a validation of 10 runs, 7 boards, a
lens, and points that were matched and measured."""
SLOW = 120


def placed(source: Path, home: Path) -> Project:
    """The project of a zip."""
    return unpack_project(source, source.name, home)


def session(project: Project, **state: object) -> AppTest:
    """A browser tab with the project's address."""
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    app.query_params["project"] = project.id
    for key, value in state.items():
        app.session_state[key] = value
    return app.run()


def again(app: AppTest, page: str) -> AppTest:
    """A page of the same project, in a new tab."""
    tab = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW)
    tab.query_params["project"] = app.session_state["project_id"]
    return go(tab.run(), page)


def project_of(app: AppTest, home: Path) -> Project:
    return Project.open(home, app.session_state["project_id"])


def go(app: AppTest, page: str) -> AppTest:
    return app.switch_page(f"pages/{page}.py").run()


def told(app: AppTest, *kinds: str) -> str:
    wanted = kinds or ("error", "info", "warning", "success", "caption", "markdown")
    found = [str(item.value) for kind in wanted for item in getattr(app, kind)]
    return " ".join(found).replace("\\", "")


def messages(app: AppTest) -> str:
    return told(app, "error", "info", "warning", "success")
