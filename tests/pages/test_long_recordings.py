"""Pages of long recordings: no draw computes what takes long; a job does, and the page follows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from streamlit.testing.v1 import AppTest

from stereocal.ui import jobs, refined, results, screening
from tests.pages.stored_projects import messages, project_of
from tests.pages.test_pages import open_sample
from tests.pages.waiting import ended

COMPUTING = (
    (screening, "screened"),
    (refined, "refine"),
    (refined, "trade_off"),
    (refined, "calibrate"),
    (refined, "outlook_of"),
    (refined, "answer"),
    (results, "pack_dataset"),
)


@pytest.fixture
def long(app: AppTest, monkeypatch: pytest.MonkeyPatch) -> AppTest:
    """The sample, as if its frames were many, on a server that has computed nothing yet."""
    monkeypatch.setattr(screening, "MOST_AT_ONCE", 10)
    open_sample(app)
    forget()
    return app


def forget() -> None:
    """What a server that starts has not in memory."""
    for cache in (screening._screened, refined.refined_of, refined.outlook_for, refined._made):
        cache.clear()
    jobs._jobs().clear()


def forbid(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let everything fail that takes long with many frames."""

    def called(*_: Any, **__: Any) -> None:
        raise AssertionError("computed while the page was drawn")

    for module, name in COMPUTING:
        monkeypatch.setattr(module, name, called)


@pytest.mark.parametrize("name", ["data", "calibrate", "validate", "one_set"])
def test_no_page_computes_before_the_press(
    name: str, long: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project_of(long, home).keep_settings({"validate_runs": 500})  # as long as of many frames
    forbid(monkeypatch)
    long.switch_page(f"pages/{name}.py").run()
    assert not long.exception
    if name == "one_set":
        assert "press Calibrate first" in messages(long)


def test_the_press_and_a_restart(
    long: AppTest, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    project = project_of(long, home)
    project.keep_settings({"validate_runs": 10, "one_set_view": "The refined set"})
    long.switch_page("pages/calibrate.py").run()
    long.button(key="run").click().run()
    assert ended(project, "calibration").state == "done"
    with monkeypatch.context() as patch:
        forbid(patch)
        long.run()
        assert "Use the refined set for both" in messages(long)
        for name in ("validate", "one_set"):
            long.switch_page(f"pages/{name}.py").run()
            assert not long.exception
            assert "Use the refined set for both" in messages(long) or name == "validate"
    forget()  # the server starts again
    pages = ("calibrate", "one_set", "apply", "check")
    begun: list[jobs.Work] = []
    with monkeypatch.context() as patch:
        patch.setattr(jobs, "start", begun.append)
        forbid(patch)
        for name in pages:
            long.switch_page(f"pages/{name}.py").run()
            assert not long.exception
    assert [work.kind for work in begun] == ["answer"] * len(pages)
    jobs.start(begun[0])
    assert ended(project, "answer").state == "done"
    for name in pages:
        long.switch_page(f"pages/{name}.py").run()
        assert not long.exception
        assert "Use the refined set for both" in messages(long) or name in ("apply", "check")
