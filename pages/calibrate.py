"""Calibrate: one press to the recommendation and the parameter files."""

from stereocal.ui.menu import page_head

page_head("Calibrate", "What is the pose of the cameras, and which set serves what?")

import streamlit as st

from stereocal.ui.forms import settings_form, settings_of, staleness
from stereocal.ui.messages import ErrorsShown, end_here, readable
from stereocal.ui.navigation import went_on_to
from stereocal.ui.plan import show_planned
from stereocal.ui.prerequisites import project_with_data
from stereocal.ui.press import Press, show_progress
from stereocal.ui.refined import answer_when_ready
from stereocal.ui.results import show_result
from stereocal.ui.screening import calibrate_again, show_exchanged

came = went_on_to("calibrate")
project, inputs, dataset = project_with_data()
result = readable(lambda: project.calibration)
first = came and result is None
label = "Calibrate again" if result else "Calibrate"
pressed = st.button(label, type="primary", key="run")
values = settings_form(project, dataset)
show_exchanged(project)
work = None
with ErrorsShown():
    own = Press(project, inputs, dataset, settings_of(values))
    if calibrate_again() or pressed or first:
        own.press(errors_first=not (pressed or first))
        result = readable(lambda: project.calibration)
    work = own.work
show_progress(project, work)

if result is None:
    st.info("No result yet. The settings are good as they are: press Calibrate.")
    end_here()
if stale := staleness(result, dataset, values):
    st.warning(stale)
show_planned(project)
show_result(project, result, answer_when_ready(project, result))
