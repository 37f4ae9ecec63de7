"""Validate: errors of the parameter sets on held-out frames."""

from stereocal.ui.menu import page_head

page_head("Validate", "How often would a wrong pair be accepted, and how far off is a length?")

import streamlit as st

from stereocal.ui.messages import ErrorsShown, end_here
from stereocal.ui.prerequisites import project_with_data
from stereocal.ui.texts import VALIDATE
from stereocal.ui.validation import (
    choose_data,
    choose_protocol,
    last_validation,
    update_validation,
    without_refined,
)
from stereocal.ui.validation_results import show_evaluation, with_refined

project, _, own = project_with_data("validate")
with ErrorsShown(end=True):
    datasets = choose_data(project, own)
    settings = choose_protocol(project, datasets)
# The paper's figure at once; the refined sets, which other pages need too, after it.
first = None if with_refined(project).value() else without_refined(project, datasets, settings)
if first is None:
    update_validation(project, datasets, settings)
evaluation = first or last_validation(project, datasets, settings)
if evaluation is None:
    st.info("No validation yet.")
    end_here()
show_evaluation(project, evaluation, datasets)
if first is not None:
    update_validation(project, datasets, settings)
with st.expander("What these figures mean"):
    st.markdown(VALIDATE)
