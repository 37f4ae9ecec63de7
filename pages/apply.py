"""Apply: match points and reconstruct them in 3D."""

from stereocal.ui.menu import page_head

page_head("Apply", "Which points belong together, and where are they?")

import streamlit as st

from stereocal.projects.application import ProjectApplication
from stereocal.ui.apply import bring_up_to_date, choose_inputs
from stereocal.ui.apply_results import show_application
from stereocal.ui.messages import ErrorsShown, end_here
from stereocal.ui.project import begin_project, current_project

project = current_project()
if project is None:
    st.info("Before this page can answer, it needs points of both cameras and parameter files.")
    st.page_link("pages/data.py", label="Calibrate first: give points on the Data page")
    st.button("I have both as files", on_click=begin_project, key="apply_begin")
    end_here()

store = ProjectApplication(project)
chosen = None
with ErrorsShown():
    chosen = choose_inputs(project, store)
    if chosen is not None and chosen.work is not None:
        bring_up_to_date(project, store, chosen.work)
show_application(project, store, chosen)
