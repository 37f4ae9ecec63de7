"""Start: the story on a real recording, data to begin with, recent projects, what you need."""

from stereocal.ui.menu import ensure_navigation

ensure_navigation()


import streamlit as st

from stereocal.ui.project import forget_project, projects_in_creation
from stereocal.ui.projects import show_projects, show_storage
from stereocal.ui.samples import (
    begin_sample,
    has_sample_photographs,
    real_recording,
    sample_photographs,
    sample_points,
    three_cameras,
)
from stereocal.ui.story import show_story
from stereocal.ui.texts import NEEDED, PURPOSE

st.title("Two cameras, a bar, two lengths")
st.markdown(PURPOSE)
show_story()

samples = {"recording": ("Open the real recording", real_recording)}
if has_sample_photographs():
    samples["demo_photographs"] = ("Sample photographs", sample_photographs)
samples["demo_rig"] = ("Three cameras", three_cameras)
samples["demo"] = ("Simulated rig", sample_points)
with st.container(horizontal=True):
    for key, (label, make) in samples.items():
        st.button(
            label,
            type="primary" if key == "recording" else "secondary",
            key=key,
            on_click=begin_sample,
            args=(projects_in_creation(), make),
        )
    if st.button("Start with my own data", key="begin"):
        forget_project()
        st.switch_page("pages/data.py")
    if st.button("Plan a field day", key="begin_plan"):
        forget_project()
        st.switch_page("pages/plan.py")

project = show_projects()

st.markdown("#### What you need")
st.markdown(NEEDED)
show_storage(project)
