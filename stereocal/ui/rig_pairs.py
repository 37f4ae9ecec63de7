"""The pairs of a rig: buttons that open the pages of one."""

from functools import partial

import streamlit as st

from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.ui.messages import callback
from stereocal.ui.navigation import go_to
from stereocal.ui.project import open_project
from stereocal.ui.screening import calibrate_next
from stereocal.ui.texts import escape_markdown

OPENED = "The bars that both cameras saw, with the rig's lenses and baseline."


def pair_buttons(project: Project, page: str = "calibrate") -> None:
    """A button for each pair that shares bars.

    Args:
        page: what it opens.
    """
    store = ProjectRecording(project)
    with st.container(horizontal=True):
        for name in store.pair_names:
            press = partial(open_pair, store, name, page)
            shown = f"Pair {escape_markdown(name)}"
            st.button(shown, key=f"open_pair_{name}", on_click=press, help=OPENED)


@callback
def open_pair(store: ProjectRecording, name: str, page: str = "calibrate") -> None:
    """Open a page of a pair; Calibrate calibrates it the first time (a callback)."""
    pair = store.pair(name)
    open_project(pair.id, name)
    if page == "calibrate" and pair.calibration is None:
        calibrate_next()
    go_to(page)
