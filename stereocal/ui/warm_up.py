"""What the server does in the background from its start, and what pages show of it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.runtime.scriptrunner import add_script_run_ctx, get_script_run_ctx

from stereocal.commands.warming import compile_all
from stereocal.errors import StereocalError
from stereocal.projects.data_folder import default_home
from stereocal.projects.home import sweep
from stereocal.projects.server_settings import ServerSettings

SWEEP_EVERY_S = 3600.0
LOOK_EVERY_S = 0.3
_LOG = logging.getLogger(__name__)


class WarmUp:
    """How far the server has compiled; its thread writes, pages only read."""

    def __init__(self) -> None:
        self.done = 0
        self.total = 0
        """0 until something begins to be compiled: all may be in the cache."""
        self.over = False

    @property
    def compiling(self) -> bool:
        """Whether something is being compiled."""
        return self.total > 0 and not self.over

    @property
    def share(self) -> float:
        """Of the functions, those that are compiled."""
        return self.done / max(self.total, 1)

    @property
    def sentence(self) -> str:
        """How far it is."""
        return f"Compiling once: {self.done} of {self.total} functions"

    def run(self) -> None:
        """Delete what is too old, compile, and look again every hour."""
        _sweep()
        try:
            compile_all(self._heard)
        except Exception:  # what cannot be compiled now says so where it is used
            _LOG.exception("The server could not compile everything ahead.")
        self.over = True
        while True:
            time.sleep(SWEEP_EVERY_S)
            _sweep()

    def _heard(self, done: int, total: int) -> None:
        self.done, self.total = done, total


@st.cache_resource(show_spinner=False)
def warm_up() -> WarmUp:
    """What is done in the background; it begins with the first call."""
    state = WarmUp()
    threading.Thread(target=state.run, daemon=True, name="warm-up").start()
    return state


@contextmanager
def compiling_shown(place: DeltaGenerator) -> Iterator[None]:
    """While the server compiles, show how far it is, to those whose page waits for it.

    By a thread: what the script of the page itself draws could end it in the middle.
    """
    state = warm_up()
    if state.over:
        yield
        return
    bar = place.empty()
    ended = threading.Event()

    def draw() -> None:
        while not ended.wait(LOOK_EVERY_S) and not state.over:
            if state.compiling:
                bar.progress(state.share, state.sentence)
        bar.empty()

    thread = threading.Thread(target=draw, daemon=True, name="compiling shown")
    add_script_run_ctx(thread, get_script_run_ctx())
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


def _sweep() -> None:
    """What cannot be swept, as on a home that is read-only, is left for the next time."""
    with suppress(StereocalError, OSError):
        settings = ServerSettings.from_environment()
        sweep(default_home(), settings.undo_days, settings.keep_days)
