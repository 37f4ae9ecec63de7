"""The list of pages, and how one is run with its messages and errors."""

from __future__ import annotations

import logging
import os

import streamlit as st
from streamlit.navigation.page import StreamlitPage
from streamlit.runtime.scriptrunner import StopException

from stereocal.errors import StereocalError
from stereocal.projects.server_settings import ServerSettings
from stereocal.system.executors import scheduler_of
from stereocal.system.limits import Limits
from stereocal.ui.fields import begin_page, end_page
from stereocal.ui.messages import callback, forget_messages, show_messages
from stereocal.ui.project import forms_are_sound, open_created, reset_forms
from stereocal.ui.texts import escape_markdown
from stereocal.ui.uploads import check_dropped
from stereocal.ui.warm_up import compiling_shown

TITLES = {
    "start": "Start",
    "cameras": "Cameras",
    "data": "Data",
    "calibrate": "Calibrate",
    "validate": "Validate",
    "one_set": "One set or two",
    "apply": "Apply",
}
"""The pages in the order of the work, by the name of their file in `pages/`; with hyphens it is the
last part of the address."""

FITS = """<style>
[data-testid=stFileUploaderDropzoneInstructions] span { white-space: normal; }
button:focus-visible, a:focus-visible, summary:focus-visible {
  outline: 2px solid currentColor; outline-offset: 2px;
}
</style>"""
"""Streamlit cuts off long lists of file types, and shows no focus on a chosen button."""

_DRAWN = "frame_drawn"
_LOG = logging.getLogger(__name__)


def pages() -> list[StreamlitPage]:
    """All pages of the dashboard."""
    return [
        st.Page(
            f"pages/{name}.py",
            title=title,
            url_path=name.replace("_", "-"),
            default=name == "start",
        )
        for name, title in TITLES.items()
    ]


def check_settings() -> None:
    """Show an invalid setting of the server on every page, and stop."""
    try:
        ServerSettings.from_environment()
        Limits.from_environment()
        scheduler_of(os.environ)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        st.stop()


def mark_app_running() -> None:
    """Note that `app.py` runs the page."""
    st.session_state[_DRAWN] = True
    st.html(FITS)


def ensure_navigation() -> None:
    """Run `app.py` first, if Streamlit has started a page by itself.

    If the first request to a new server is for a bookmarked page, Streamlit runs that file in
    `pages/` alone. One call of `st.navigation` ends that mode.
    """
    if _DRAWN not in st.session_state:
        st.navigation(pages())
        st.rerun()


def run_page(page: StreamlitPage) -> None:
    """Draw a page with the queued messages above it.

    Errors of a project on disk are shown as messages. If a page fails over values of its forms,
    which an older version may have left, the forms are reset.
    """
    callback(check_dropped)()
    if open_created() and page.url_path == "":
        st.switch_page("pages/data.py")
    top = st.container()
    shown = show_messages(top)
    begin_page(page.url_path)
    try:
        with compiling_shown(top):
            _draw(page)
    except StopException:
        end_page()
        forget_messages(shown)
        raise
    end_page()
    # Messages queued meanwhile; if the page is drawn again, it shows all of them.
    forget_messages(shown + show_messages(top, shown))


def _draw(page: StreamlitPage) -> None:
    try:
        page.run()
        forms_are_sound()
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
    except OSError as error:
        reason = f"{error.strerror or error}"
        st.error(escape_markdown(f"The project's folder cannot be used: {reason}."))
    except Exception:
        if not reset_forms():
            raise  # the forms are not the cause
        _LOG.exception("A page could not be drawn; its forms are reset.")
        st.rerun()
