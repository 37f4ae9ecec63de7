"""Check: has a camera moved since the parameters were found?"""

from stereocal.ui.menu import page_head

page_head("Check", "Has a camera moved?")

import streamlit as st

from stereocal.projects.application import ProjectCheck
from stereocal.ui.check import choose_inputs, show_check
from stereocal.ui.messages import end_here
from stereocal.ui.project import begin_project, current_project

project = current_project()
if project is None:
    st.info(
        "Before this page can answer, it needs the parameters of the rig, and a few new bars or "
        "matched points."
    )
    st.page_link("pages/data.py", label="Calibrate first: give points on the Data page")
    st.button("I have both as files", on_click=begin_project, key="check_begin")
    end_here()

chosen = choose_inputs(project, ProjectCheck(project))
if chosen is not None:
    show_check(chosen)
