"""Background work of the server: compilation at its start, and deletion of old projects."""

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
    """Progress of the compilation. Its thread writes; pages only read."""

    done = 0
    total = 0
    """0 until a compilation begins: everything may be in the cache."""
    over = False

    def show(self, bar: DeltaGenerator) -> None:
        """The progress, if something is being compiled."""
        if self.total and not self.over:
            said = f"Compiling once: {self.done} of {self.total} functions"
            bar.progress(self.done / self.total, said)

    def run(self) -> None:
        """Delete old projects, compile, and delete old projects every hour."""
        _sweep()
        try:
            compile_all(self._count)
        except Exception:  # reported again where the function is used
            _LOG.exception("The server could not compile everything ahead.")
        self.over = True
        while True:
            time.sleep(SWEEP_EVERY_S)
            _sweep()

    def _count(self, done: int, total: int) -> None:
        self.done, self.total = done, total


@st.cache_resource(show_spinner=False)
def warm_up() -> WarmUp:
    """The background work; the first call starts it."""
    state = WarmUp()
    threading.Thread(target=state.run, daemon=True, name="warm-up").start()
    return state


@contextmanager
def compiling_shown(place: DeltaGenerator) -> Iterator[None]:
    """Show the progress of the compilation above a page until it is over.

    While the page is drawn, a thread shows it: drawing in the page's own script could end that
    halfway. Nothing of a thread arrives once the page is drawn; a fragment takes over.
    """
    if warm_up().over:
        yield
        return
    drawn = threading.Event()
    bar = place.empty()
    with place:
        _show_when(drawn)

    def show() -> None:
        while not drawn.is_set() and not warm_up().over:
            warm_up().show(bar)
            drawn.wait(LOOK_EVERY_S)
        bar.empty()

    thread = threading.Thread(target=show, daemon=True, name="compiling shown")
    add_script_run_ctx(thread, get_script_run_ctx())
    thread.start()
    try:
        yield
    finally:
        drawn.set()
        thread.join()


@st.fragment(run_every=LOOK_EVERY_S)
def _show_when(drawn: threading.Event) -> None:
    if warm_up().over:
        st.rerun()
    bar = st.empty()  # in place of the bar of the page before
    if drawn.is_set():
        warm_up().show(bar)


def _sweep() -> None:
    """Delete old projects. Errors, as on a read-only disk, are ignored until the next time."""
    with suppress(StereocalError, OSError):
        settings = ServerSettings.from_environment()
        sweep(default_home(), settings.undo_days, settings.keep_days)
