"""How a page is run: its messages and errors, the way to the next, and the server's own work."""

import os
import signal
import sys
import threading
from collections.abc import Mapping
from itertools import pairwise

import streamlit as st
from streamlit import runtime
from streamlit.navigation.page import StreamlitPage
from streamlit.runtime.scriptrunner import StopException

from stereocal.errors import StereocalError
from stereocal.projects.database import kept_open
from stereocal.projects.one_server import take_projects
from stereocal.projects.server_settings import ServerSettings, default_home
from stereocal.system.executors import scheduler_of
from stereocal.system.limits import Limits
from stereocal.ui.fields import begin_page, end_page
from stereocal.ui.figure import tell_screen
from stereocal.ui.menu import OTHER_ADDRESSES, PRESS_FIRST, STATES, TITLES, show_menu
from stereocal.ui.messages import ErrorsShown, button, forget_messages, show_messages
from stereocal.ui.page_states import PageState, page_states
from stereocal.ui.project import open_created, open_or_none, show_project, show_saved
from stereocal.ui.texts import escape_markdown
from stereocal.ui.warm_up import compiling_shown

FITS = """<style>
[data-testid=stFileUploaderDropzoneInstructions] span { white-space: normal; }
button:focus-visible, a:focus-visible, summary:focus-visible {
  outline: 2px solid currentColor !important; outline-offset: 2px;
}
[data-testid=stCaptionContainer] { color: inherit; opacity: 0.8; }
[data-testid=stPlotlyChart] svg :not(.hovertext) > text { fill: currentColor !important; }
[data-testid=stPlotlyChart] .textpoint text {
  paint-order: stroke; stroke: Canvas; stroke-width: 3px;
}
[data-testid=stCode] span { color: inherit !important; }
button :has(kbd), button kbd { color: inherit !important; opacity: 1 !important; }
[data-testid=stButtonGroup] [data-selected], [data-testid=stSliderThumbValue] {
  color: inherit !important;
}
.st-key-arrival, .st-key-arrival_screen { display: none; }
[data-testid=stSidebarNavItems] > :first-child [data-testid=stNavSectionHeader] {
  font-size: 1.5rem; color: inherit !important;
}
@media (hover: none) {
  [data-testid=stPlotlyChart] .modebar:has(.modebar-group ~ .modebar-group) { display: none; }
  [data-testid=stPlotlyChart] .modebar { background: none !important; }
}
@media (hover: hover) {
  [data-testid=stPlotlyChart]:not(:hover) .modebar,
  [data-testid=stHeadingWithActionElements]:not(:hover) [data-testid=stHeaderActionElements] a {
    visibility: hidden;
  }
}
</style>"""
"""Streamlit cuts off long lists of file types, and shows no focus on a chosen button. Its captions,
figures, commands and chosen values have texts with a contrast of 2.3 to 4.2 with the page; 4.5 is
the least that can be read well (WCAG 2.1, 1.4.3). Labels of points have a rim of the page's colour:
a photograph below them is dark in one place and light in the next. What is shown only under the
mouse is no stop of the Tab key: the toolbars of three figures were 18 stops before the first button
of Start. Without a mouse they would lie over the figures for good; fingers move and zoom without
them, and only the one button that saves a figure stays."""
ARRIVAL = """<script>/* {} */
(() => {
  const main = document.querySelector('[data-testid=stMain]')
  if (document.activeElement !== document.body && !main.contains(document.activeElement)) return
  main.tabIndex = main.tabIndex  // else a place that is not a control takes no focus
  main.focus({ preventScroll: true })
})()
</script>"""
"""Runs in the browser when the text in its comment is new. The focus of a button that led to a page
would be on nothing, or on the button of the same name at the end. A link of the menu keeps it."""

ENDS_S = 3.0
"""What a second server of the same projects takes to end: until its page has been drawn."""
_NEXT, _PAGE = "next_page", "page_at"


def check_settings() -> None:
    """Show an invalid setting of the server on every page, and stop; a second server of the same
    projects says so and ends."""
    with ErrorsShown(end=True):
        ServerSettings.from_environment()
        Limits.from_environment()
        scheduler_of(os.environ)
        try:
            take_projects(default_home())
        except StereocalError as error:
            if runtime.exists():  # not in a test without a server
                print(f"stereocal: {error}", file=sys.stderr)
                threading.Timer(ENDS_S, os.kill, (os.getpid(), signal.SIGTERM)).start()
            raise


@kept_open()
def run_page(page: StreamlitPage) -> None:
    """Draw a page with the queued messages above it; errors of a project become messages."""
    st.html(FITS)
    if chosen := st.session_state.pop(_NEXT, None):
        st.switch_page(chosen)
    if open_created() and page.url_path == "":  # a sample that was just opened goes on
        st.switch_page("pages/data.py")
    top = st.container()
    shown_messages = show_messages(top)
    _take_focus(page)
    tell_screen()
    begin_page(page.url_path)
    project = open_or_none()
    with st.sidebar:
        saved = show_project(project)
    stopped = None
    try:
        with compiling_shown(top):
            try:
                with ErrorsShown():
                    page.run()
            except OSError as error:
                reason = escape_markdown(f"{error.strerror or error}")
                st.error(f"The project's folder cannot be used: {reason}.")
        _show_next(page, page_states(project))
    except StopException as stop:
        stopped = stop
    end_page()
    # What the page has changed: the time of the last change, and the states in the menu.
    show_saved(project, saved)
    states = page_states(project)
    if states != st.session_state.get(STATES, {}):
        st.session_state[STATES] = states
        show_menu()
    # Messages queued meanwhile; if the page is drawn again, it shows all of them.
    forget_messages(shown_messages + show_messages(top, shown_messages))
    if stopped is not None:
        raise stopped


def _take_focus(page: StreamlitPage) -> None:
    """Let the keyboard begin at the top of a page that was opened from another."""
    before, arrived = st.session_state.get(_PAGE, (page.url_path, ""))
    if before != page.url_path:
        arrived = f"from {before} to {page.url_path}"
    st.session_state[_PAGE] = page.url_path, arrived
    with st.container(key="arrival"):
        if arrived:
            st.html(ARRIVAL.replace("{}", arrived), unsafe_allow_javascript=True)


def _show_next(page: StreamlitPage, states: Mapping[str, PageState]) -> None:
    """The button to the next page; none on Start, which has its own, on the last page, and on Data
    while points are missing.

    It stands out unless something on this page is to be pressed first.
    """
    press_first = st.session_state.pop(PRESS_FIRST, False)
    order = [name for name in TITLES if name != "help"]
    following = dict(pairwise(order)).get(OTHER_ADDRESSES.get(page.url_path, page.url_path))
    data = states.get(page.url_path) if page.url_path == "data" else None
    if following is not None and (data is None or data.mark != "missing"):
        label = f"Next: {TITLES[following]}"
        button(label, "next", go_to, following, first=not press_first, icon="arrow_forward")


def go_to(name: str) -> None:
    """Open a page (for callbacks)."""
    st.session_state[_NEXT] = f"pages/{name}.py"
