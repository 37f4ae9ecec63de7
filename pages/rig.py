"""Rig: three cameras and more, calibrated together."""

from stereocal.ui.menu import page_head

page_head("Rig", "Do all cameras agree?")

import streamlit as st

from stereocal.projects.recording import ProjectRecording
from stereocal.ui.messages import end_here
from stereocal.ui.project import current_project
from stereocal.ui.rig import show_rig_page

project = current_project()
recording = None if project is None else ProjectRecording(project).read()
if project is None or recording is None:
    st.info(
        "This page is for recordings of three cameras and more: give their files on the Data page, "
        "under *Three cameras and more*."
    )
    st.page_link("pages/data.py", label="Give it on the Data page")
    end_here()
show_rig_page(project, recording)
