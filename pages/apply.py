"""Apply: match points and reconstruct them in 3D."""

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.matching.application import Application
from stereocal.projects.application import ProjectApplication
from stereocal.ui.apply import (
    bring_up_to_date,
    choose_points,
    choose_sets,
    choose_threshold_and_depths,
)
from stereocal.ui.apply_results import show_application
from stereocal.ui.intake import escape_markdown, show_refusal
from stereocal.ui.navigation import ensure_navigation
from stereocal.ui.project import begin_project, current_project

ensure_navigation()
st.title("Apply")
st.subheader("Which points of the two cameras belong together, and where are they in space?")

project = current_project()
if project is None:
    st.info("Before this page can answer, it needs points of both cameras and parameter files.")
    st.page_link("pages/data.py", label="Calibrate first: give points on the Data page")
    st.button("I have both as files", on_click=begin_project, key="apply_begin")
    st.stop()

store = ProjectApplication(project)
work = None
try:
    points = choose_points(project, store)
    sets = choose_sets(project, store)
    show_refusal()
    if points is None:
        st.info("Still missing: the points of both cameras.")
    if sets is None:
        st.info("Still missing: a parameter file to match with, and one to measure with.")
        st.page_link("pages/calibrate.py", label="Or calibrate on the Calibrate page")
    limits = choose_threshold_and_depths(store, points, sets[0]) if points and sets else None
    if points and sets and limits:
        work = Application(*points, *sets, *limits)
        bring_up_to_date(project, store, work)
except StereocalError as error:
    st.error(escape_markdown(str(error)))
try:
    show_application(project, store, work)
except StereocalError as error:
    st.error(escape_markdown(str(error)))
