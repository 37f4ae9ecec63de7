"""AppTest as the server does it: every page is run by `app.py`."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import MagicMock

import pytest
from streamlit.components.v2.component_manager import BidiComponentManager
from streamlit.runtime import Runtime
from streamlit.runtime.pages_manager import PagesManager
from streamlit.runtime.scriptrunner.script_cache import ScriptCache
from streamlit.testing.v1 import AppTest, app_test, local_script_runner
from streamlit.testing.v1.local_script_runner import LocalScriptRunner, require_widgets_deltas

from stereocal.projects.home import find_projects
from stereocal.projects.project import Project
from stereocal.ui import jobs
from tests.pages.stored_projects import SLOW, dashboard, page_of

SCRIPTS = ScriptCache()
"""Pages that have been compiled; a server keeps them too."""
SERVER = MagicMock(spec=Runtime)
"""What AppTest has in place of a server, and makes anew for every run: 5 ms, and as much for each
of its attributes."""


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty home of projects."""
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    return tmp_path


@pytest.fixture
def app(home: Path) -> Iterator[AppTest]:
    """The dashboard, freshly opened at that home."""
    assert home.is_dir()
    started = dashboard()
    assert not started.exception
    yield started
    assert not started.exception


@pytest.fixture(scope="session")
def home_of_sample(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A home with the sample, calibrated and validated by one press."""
    home = tmp_path_factory.mktemp("sample")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STEREOCAL_HOME", str(home))
        as_in_a_server(patch)
        app = dashboard()
        app.button(key="demo").click().run().switch_page("pages/calibrate.py").run()
        app.button(key="run").click().run()
        assert not app.exception
    return home


@pytest.fixture
def pressed(home: Path, home_of_sample: Path) -> Iterator[AppTest]:
    """The Calibrate page of a copy of that sample."""
    shutil.copytree(home_of_sample, home, dirs_exist_ok=True)
    (project,) = find_projects(home)
    opened = page_of(Project.open(home, project), "calibrate")
    yield opened
    assert not opened.exception


@pytest.fixture(autouse=True)
def main_stays_main() -> Iterator[None]:
    """AppTest puts its script in place of `__main__`, which processes begun later would run."""
    main = sys.modules["__main__"]
    yield
    sys.modules["__main__"] = main


@pytest.fixture(autouse=True)
def done_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """In every test of pages."""
    as_in_a_server(monkeypatch)


def as_in_a_server(patch: pytest.MonkeyPatch) -> None:
    """Do once what a server does once, and AppTest before every run.

    A server that has run `app.py` once does not look for a folder `pages/` any more.
    """
    begin = PagesManager.__init__

    def begin_with_navigation(self: PagesManager, *given: object, **named: object) -> None:
        begin(self, *given, **named)  # type: ignore[arg-type]
        PagesManager.uses_pages_directory = False

    def drawn(runner: LocalScriptRunner, timeout: float = 3) -> None:
        """Sleeps, where AppTest looks a thousand times a second, which is a seventh of its work."""
        if (thread := runner._script_thread) is not None:
            thread.join(timeout)
        require_widgets_deltas(runner, 1)

    # A page waits for the end of a job that has just begun, however slow the machine.
    patch.setattr(jobs, "WAIT_S", SLOW)
    patch.setattr(PagesManager, "__init__", begin_with_navigation)
    patch.setattr(local_script_runner, "require_widgets_deltas", drawn)
    patch.setattr(local_script_runner, "ScriptCache", lambda: SCRIPTS)
    patch.setattr(app_test, "MagicMock", lambda **_: SERVER)
    patch.setattr(BidiComponentManager, "discover_and_register_components", lambda *_, **__: None)
