"""Calibrate: the three methods, side by side, and the two files."""

import streamlit as st

from stereocal.calibrate import calibrate
from stereocal.errors import StereocalError
from stereocal.ui.forms import settings_form, settings_of
from stereocal.ui.frame import need_frame
from stereocal.ui.intake import escape_markdown
from stereocal.ui.project import current_project
from stereocal.ui.refined import refined_for
from stereocal.ui.results import show_result
from stereocal.ui.status import describe_settings, staleness

need_frame()
st.title("Calibrate")
st.subheader("How do the cameras stand, and how large are the errors?")

project = current_project()
try:
    inputs = project.inputs if project else None
    dataset = project.dataset_of(inputs) if project and inputs else None
except StereocalError as error:
    st.error(escape_markdown(str(error)))
    st.stop()
if project is None or inputs is None or dataset is None:
    missing = ", ".join(inputs.missing) if inputs else "points, cameras and two lengths"
    st.info(f"Before this page can answer, it needs {missing}.")
    st.page_link("pages/data.py", label="Give them on the Data page")
    st.stop()

values = settings_form(project, dataset)
if st.button("Calibrate", type="primary", key="run"):
    try:
        with st.spinner("Calibrating. The very first time takes about ten seconds longer."):
            project.keep_calibration(calibrate(dataset, settings_of(values), trace=True), inputs)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))

try:
    result, evaluation = project.calibration, project.evaluation
except StereocalError as error:
    st.error(escape_markdown(str(error)))
    st.stop()
if result is None:
    st.info("No result yet. The settings are good as they are: press Calibrate.")
    st.stop()
st.header("Result", divider="gray")
if stale := staleness(result, dataset, values):
    st.warning(stale)
refined, instead = refined_for(project, result)
show_result(result, evaluation, refined, instead)
st.caption(describe_settings(result))
