"""Lenses: the lens of each camera, from photographs of a board or from a camera file."""

from stereocal.ui.menu import page_head

page_head("Lenses", "How does each camera's lens see, and how well is that known?")

import streamlit as st

from stereocal.ui import lens as page
from stereocal.ui.messages import show_refusal
from stereocal.ui.print_downloads import board_to_print
from stereocal.ui.project import current_project
from stereocal.ui.texts import BOARDS

project = current_project()
of_rig = project is not None and project.pair is None and page.show_cameras_of_rig(project)
if not of_rig:
    page.show_cameras_in_use(project)
    which, how = page.choose_camera(project)
    if how == "A camera file":
        page.from_file(project, which)
        show_refusal()
    else:
        with st.expander("How to take the photographs"):
            st.markdown(BOARDS)
        board_to_print(project)
        store = page.from_photographs(which)
        show_refusal()
        if store is None:
            page.tell_what_is_loaded(project, which)
        else:
            page.show_lens(store)
