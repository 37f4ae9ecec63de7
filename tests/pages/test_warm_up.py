"""While the server compiles: Start does not wait, and pages that do show how far it is."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.testing.v1 import AppTest

from stereocal.system.tasks import Progress
from stereocal.ui import warm_up

APP = Path(__file__).parents[2] / "app.py"
LONGEST_S = 300
"""Only so that a test that hangs ends."""


class Compiling:
    """A server that has compiled 12 of 98 functions and stays there until `ended` is set."""

    def __init__(self) -> None:
        self.begun = threading.Event()
        self.ended = threading.Event()
        self.drawn = threading.Event()
        self.shown: list[tuple[float, str]] = []

    def compile_all(self, progress: Progress) -> int:
        progress(12, 98)
        self.begun.set()
        self.ended.wait(LONGEST_S)
        return 98

    def progress(self, _: DeltaGenerator, value: float, text: str) -> None:
        self.shown.append((value, text))
        self.drawn.set()


@pytest.fixture
def compiling(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[Compiling]:
    monkeypatch.setenv("STEREOCAL_HOME", str(tmp_path))
    state = Compiling()
    monkeypatch.setattr(warm_up, "compile_all", state.compile_all)
    monkeypatch.setattr(
        DeltaGenerator, "progress", lambda place, value, text: state.progress(place, value, text)
    )
    warm_up.warm_up.clear()
    yield state
    state.ended.set()
    warm_up.warm_up.clear()


def test_start_does_not_wait(compiling: Compiling) -> None:
    app = AppTest.from_file(str(APP), default_timeout=LONGEST_S).run()
    assert compiling.begun.wait(LONGEST_S)
    assert not app.exception
    assert app.button(key="demo")
    assert warm_up.warm_up().compiling


def test_a_page_that_waits_shows_how_far_it_is(compiling: Compiling) -> None:
    ended_while_it_waited = []

    def page() -> None:
        st.title("A page")
        assert compiling.drawn.wait(LONGEST_S)  # as it waits for compiled code
        ended_while_it_waited.append(compiling.ended.is_set())

    def script(page: object, shown: object) -> None:
        import streamlit as st

        with shown(st.container()):  # type: ignore[operator]
            page()  # type: ignore[operator]

    app = AppTest.from_function(
        script, default_timeout=LONGEST_S, args=(page, warm_up.compiling_shown)
    ).run()
    assert not app.exception
    assert ended_while_it_waited == [False]
    share, sentence = compiling.shown[0]
    assert share == pytest.approx(12 / 98)
    assert "12 of 98" in sentence
    assert not [one for one in threading.enumerate() if one.name == "compiling shown"]
