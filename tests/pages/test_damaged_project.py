"""A damaged project is listed and kept, and every page says what is wrong; unforeseen errors."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from streamlit import config
from streamlit.testing.v1 import AppTest

from stereocal.errors import StereocalError
from stereocal.projects.home import recent_projects
from stereocal.projects.project import Project
from tests.pages.stored_projects import FULL, ROOT, SLOW, go, placed, session, told

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
    app = go(session(project), "start")
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
    with pytest.raises(StereocalError, match="damaged"):
        Project.open(home, project.id)
    assert "damaged" in told(go(session(project), "data"), "error")
    assert [one.damaged for one in recent_projects(home)] == [True]
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW).run()
    assert "the file of this project is damaged" in told(app, "warning")
    assert not app.exception and path.read_bytes() == before
    app.button(key=f"remove_{project.id}").click().run()
    assert not app.exception and recent_projects(home) == []


def test_unforeseen_error_tells_its_kind_and_no_more(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    app = AppTest.from_file(str(ROOT / "app.py"), default_timeout=SLOW).run()
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
