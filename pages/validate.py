"""Validate: errors of the parameter sets on held-out frames."""

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.ui.intake import escape_markdown
from stereocal.ui.navigation import ensure_navigation
from stereocal.ui.prerequisites import project_with_data
from stereocal.ui.project import last_evaluation
from stereocal.ui.texts import VALIDATE
from stereocal.ui.validation import (
    bring_up_to_date,
    choose_data,
    choose_protocol,
    show_evaluation,
)

ensure_navigation()
st.title("Validate")
st.subheader("How often does a wrong pair look right, and how far off is a distance?")

project, _, own = project_with_data()
st.markdown(VALIDATE)
try:
    datasets = choose_data(project, own)
    settings = choose_protocol(project, datasets)
except StereocalError as error:
    st.error(escape_markdown(str(error)))
    st.stop()
bring_up_to_date(project, datasets, settings)
evaluation = last_evaluation(project)
if evaluation is None:
    st.info("No validation yet.")
    st.stop()
st.header("Result", divider="gray")
show_evaluation(project, evaluation, datasets, settings)
