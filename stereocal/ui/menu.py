"""The menu of pages, and what stands on a page before the rest of the package is imported.

Imports little: a new server takes seconds for everything else, and shows these meanwhile.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

import streamlit as st
from streamlit.navigation.page import StreamlitPage

if TYPE_CHECKING:
    from stereocal.ui.page_states import PageState

SECTIONS: Mapping[str, Mapping[str, str]] = {
    "stereocal": {"start": "Start", "help": "Help"},
    "Before": {"plan": "Plan", "cameras": "Lenses"},
    "Calibrate": {"data": "Data", "calibrate": "Calibrate", "validate": "Validate"},
    "Use": {"apply": "Apply", "check": "Check"},
}
"""Titles of the pages by group and by the name of their file in `pages/`, in the order of the
work. The name is the last part of the address too. The first group is headed by the program's."""
OTHER_ADDRESSES = {
    "one_set": "calibrate",
    "rig": "calibrate",
    "start": "start",
    "lenses": "cameras",
}
"""Addresses in bookmarks, and what people type."""
TITLES = {name: title for group in SECTIONS.values() for name, title in group.items()}
_DRAWN = "menu_drawn"
PRESS_FIRST = "press_first"
"""Key of the session: the page that is drawn has a result that is lost unless a button keeps it."""
STATES = "page_states"
"""Where the session keeps the state of each page as it was last."""


def show_menu() -> StreamlitPage:
    """The menu with the state of each page as it was last; returns the chosen page."""
    st.session_state[_DRAWN] = True
    # The configuration hides Streamlit's own list of the files in `pages/`.
    st.set_option("client.showSidebarNavigation", True)
    states: Mapping[str, PageState] = st.session_state.get(STATES, {})
    sections = {
        group: [_page(name, title, states.get(name)) for name, title in titles.items()]
        for group, titles in SECTIONS.items()
    }
    sections["Use"] += [
        st.Page(f"pages/{name}.py", title=TITLES[name], url_path=address, visibility="hidden")
        for address, name in OTHER_ADDRESSES.items()
    ]
    return st.navigation(sections, expanded=True)


def page_head(title: str, question: str = "") -> None:
    """The head of a page; but `app.py` runs instead if Streamlit has started the page by itself.

    If the first request to a new server is for a bookmarked page, Streamlit runs that file of
    `pages/` alone. One call of `st.navigation` ends that mode.
    """
    if _DRAWN not in st.session_state:
        show_menu()
        st.rerun()
    st.title(title)
    if question:
        st.subheader(question)


def _page(name: str, title: str, state: PageState | None) -> StreamlitPage:
    return st.Page(
        f"pages/{name}.py",
        title=title,
        icon=state.icon if state else None,
        help=state.words if state else None,
        url_path="home" if name == "start" else name,  # the first page has no path
        default=name == "start",
    )


@contextmanager
def title_shown(page: StreamlitPage) -> Iterator[None]:
    """Show the title of a page while the package is imported: 3 s in a new server, once."""
    place = st.empty()
    if "stereocal.ui.navigation" not in sys.modules:
        with place.container():
            st.title(page.title if page.url_path else "stereocal")
            st.caption("Starting …")
    yield
    place.empty()
