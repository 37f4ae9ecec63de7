"""Calibrate: one press to the recommendation and the parameter files."""

from stereocal.ui.menu import page_head

page_head("Calibrate", "What is the pose of the cameras, and which set serves what?")

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.ui.forms import refine_form, settings_form
from stereocal.ui.messages import end_here, readable
from stereocal.ui.plan import show_planned
from stereocal.ui.prerequisites import project_with_data
from stereocal.ui.press import Press, answer_when_ready
from stereocal.ui.results import show_result
from stereocal.ui.screening import show_exchanged

project, inputs, dataset = project_with_data("calibrate")
top = st.container()
with st.expander("Settings"):
    values = settings_form(project, dataset)
    refine_form(project, dataset)
show_exchanged(project)
with top:
    Press(project, inputs, dataset, CalibrationSettings.from_json(values)).show()
run = readable(lambda: project.run)
if run is None:
    end_here()
show_planned(project)
show_result(project, run, answer_when_ready(project))
