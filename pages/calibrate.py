"""Calibrate: one press to the recommendation and the parameter files."""

from stereocal.ui.menu import page_head

page_head("Calibrate", "What is the pose of the cameras, and which file do I use?")

import streamlit as st

from stereocal.ui.forms import refine_form, settings_form
from stereocal.ui.frames import show_exchanged
from stereocal.ui.messages import end_here, readable
from stereocal.ui.plan import show_planned
from stereocal.ui.prerequisites import project_with_data, tell_no_pairs, two_cameras_of
from stereocal.ui.press import answer_when_ready, calibrate_all, show_press
from stereocal.ui.results import show_result

project = project_with_data()
if project.is_rig:
    calibrate_all(project)
    tell_no_pairs(project)
    st.header("A pair of cameras", divider="gray")
project, dataset = two_cameras_of(project)
top = st.container()
with st.expander("Settings"):
    settings_form(project, dataset)
    refine_form(project, dataset)
show_exchanged(project)
with top:
    show_press(project)
run = readable(lambda: project.run)
if run is None:
    end_here()
show_planned(project)
show_result(project, run, answer_when_ready(project))
