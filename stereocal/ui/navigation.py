"""The frame around the pages, which `app.py` draws first."""

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
from stereocal.ui.project import forms_are_sound, open_begun, reset_forms
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
"""The pages in the order of the work: the file below `pages/`, and, with hyphens, the last part of
the address."""

FITS = """<style>
[data-testid=stFileUploaderDropzoneInstructions] span { white-space: normal; }
button:focus-visible, a:focus-visible, summary:focus-visible {
  outline: 2px solid currentColor; outline-offset: 2px;
}
</style>"""
"""What Streamlit lacks: it cuts the list of kinds of files off where it does not fit, and a button
that is chosen already does not show that it has the focus."""

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
    """Say on every page that a setting of the server is none, and go no further."""
    try:
        ServerSettings.from_environment()
        Limits.from_environment()
        scheduler_of(os.environ)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        st.stop()


def mark_app_running() -> None:
    """Note that `app.py` runs and will run the page."""
    st.session_state[_DRAWN] = True
    st.html(FITS)


def ensure_navigation() -> None:
    """Run `app.py` first, if Streamlit has started a page by itself.

    A server that has just started knows nothing of `app.py`'s `st.navigation`. If the first address
    that it gets is a bookmarked page, it finds a folder `pages/` and runs that file alone, without
    the frame and the address of the project. One call of `st.navigation` ends that mode for good.
    """
    if _DRAWN not in st.session_state:
        st.navigation(pages())
        st.rerun()


def run_page(page: StreamlitPage) -> None:
    """Draw a page, and above it what is to be told.

    What a page does not foresee of a project on disk is said in a sentence. Where it fails over
    values of forms, as an older version or another page may have left them, the forms begin anew.
    """
    callback(check_dropped)()
    if open_begun() and page.url_path == "":
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
    # What has come up meanwhile; a page that is drawn once more says it all again.
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
            raise  # it is not the forms
        _LOG.exception("A page could not be drawn; its forms begin anew.")
        st.rerun()
