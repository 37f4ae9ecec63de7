"""Calibrate: comparison of the methods, and the parameter files."""

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.ui import jobs
from stereocal.ui.forms import settings_form, settings_of
from stereocal.ui.intake import escape_markdown
from stereocal.ui.navigation import ensure_navigation
from stereocal.ui.prerequisites import project_with_data
from stereocal.ui.project import last_calibration, last_evaluation
from stereocal.ui.refined import refined_for
from stereocal.ui.results import show_result
from stereocal.ui.screening import calibrate_again, show_exchanged
from stereocal.ui.status import describe_settings, staleness
from stereocal.workflow import calibrate

ensure_navigation()
st.title("Calibrate")
st.subheader("What is the pose of the cameras, and how large are the errors?")

project, inputs, dataset = project_with_data()
values = settings_form(project, dataset)
show_exchanged(project)
if st.button("Calibrate", type="primary", key="run") or calibrate_again():
    try:
        with st.spinner("Calibrating."):
            found = jobs.compute(calibrate, dataset, settings_of(values), trace=True)
            project.keep_calibration(found, inputs)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))

result, evaluation = last_calibration(project), last_evaluation(project)
if result is None:
    st.info("No result yet. The settings are good as they are: press Calibrate.")
    st.stop()
st.header("Result", divider="gray")
if stale := staleness(result, dataset, values):
    st.warning(stale)
refined, instead = refined_for(project, result)
show_result(project, result, evaluation, refined, instead)
st.caption(describe_settings(result))
