"""Validate: errors of the parameter sets on held-out frames."""

from stereocal.ui.menu import page_head

page_head("Validate", "How often would a wrong pair be accepted, and how far off is a length?")

import streamlit as st

from stereocal.ui.messages import ErrorsShown
from stereocal.ui.prerequisites import project_with_data, two_cameras_of
from stereocal.ui.texts import VALIDATE
from stereocal.ui.validation import choose_data, choose_protocol, more_data, other_settings
from stereocal.ui.validation_results import Places, show_validation

project, dataset = two_cameras_of(project_with_data())
with ErrorsShown(end=True):
    datasets = choose_data(project, dataset)
    answer = st.empty()
    settings = choose_protocol(project, datasets)
figure = st.container()
other_settings(project)
table = st.empty()
with figure:
    show_validation(project, datasets, settings, Places(answer, table))
with st.expander("What these figures mean"):
    st.markdown(VALIDATE)
more_data(project)
