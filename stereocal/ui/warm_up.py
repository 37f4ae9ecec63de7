"""The server's own work: it compiles what is not in the cache, and deletes old projects."""

import logging
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress

import streamlit as st
from streamlit.delta_generator import DeltaGenerator
from streamlit.runtime.scriptrunner import add_script_run_ctx, get_script_run_ctx

from stereocal.commands.warming import compile_all
from stereocal.errors import StereocalError
from stereocal.projects.home import sweep
from stereocal.projects.server_settings import ServerSettings, default_home
from stereocal.system.executors import in_background

SWEEP_EVERY_S = 3600.0
LOOK_EVERY_S = 0.3
_LOG = logging.getLogger(__name__)


class WarmUp:
    """Background work of the server, in a thread of its own; pages read its progress."""

    def __init__(self) -> None:
        self.done = self.total = 0
        """Functions compiled; a total of 0 until a compilation begins: all may be in the cache."""
        self.over = threading.Event()
        """Set when nothing is left to compile, and while nothing was begun."""
        self.over.set()
        self._starting = threading.Lock()
        self._started = False

    def start(self) -> None:
        """Begin, once."""
        with self._starting:
            if not self._started:
                self._started = True
                self.over.clear()
                in_background(self._run)

    def show(self, bar: DeltaGenerator) -> None:
        """The progress, if something is being compiled."""
        if self.total and not self.over.is_set():
            words = f"Compiling once: {self.done} of {self.total} functions"
            bar.progress(self.done / self.total, words)

    def _run(self) -> None:
        """Compile; delete old projects, now and every hour."""
        self._sweep()
        try:
            compile_all(self._count)
        except Exception:  # reported again where the function is used
            _LOG.exception("The server could not compile everything ahead.")
        self.over.set()
        while not threading.Event().wait(SWEEP_EVERY_S):
            self._sweep()

    def _count(self, done: int, total: int) -> None:
        self.done, self.total = done, total

    def _sweep(self) -> None:
        with suppress(StereocalError, OSError):  # as on a read-only disk: until the next time
            settings = ServerSettings.from_environment()
            sweep(default_home(), settings.undo_days, settings.keep_days)


WARM_UP = WarmUp()


@contextmanager
def compiling_shown(place: DeltaGenerator) -> Iterator[None]:
    """Show the progress of the compilation above a page until it is over.

    While the page is drawn, a thread shows it: drawing in the page's own script could end that
    halfway. Nothing of a thread arrives once the page is drawn; a fragment takes over.
    """
    if WARM_UP.over.is_set():
        yield
        return
    drawn = threading.Event()
    bar = place.empty()
    with place:
        _show_when(drawn)

    def show() -> None:
        while not drawn.is_set() and not WARM_UP.over.is_set():
            WARM_UP.show(bar)
            drawn.wait(LOOK_EVERY_S)
        bar.empty()

    thread = threading.Thread(target=show, daemon=True, name="compiling shown")
    add_script_run_ctx(thread, get_script_run_ctx())  # has to be before it starts
    thread.start()
    try:
        yield
    finally:
        drawn.set()
        thread.join()


@st.fragment(run_every=LOOK_EVERY_S)
def _show_when(drawn: threading.Event) -> None:
    if WARM_UP.over.is_set():
        st.rerun()
    bar = st.empty()  # in place of the bar of the page before
    if drawn.is_set():
        WARM_UP.show(bar)
