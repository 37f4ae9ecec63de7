"""Start: purpose, sample data, recent projects, and what to bring."""

import streamlit as st

from stereocal.ui.navigation import ensure_navigation
from stereocal.ui.project import forget_project, projects_in_creation
from stereocal.ui.projects import show_projects
from stereocal.ui.samples import (
    begin_sample,
    has_sample_photographs,
    real_recording,
    sample_photographs,
    sample_points,
)
from stereocal.ui.texts import BRING, PICTURE, PURPOSE

ensure_navigation()
st.title("stereocal")
st.subheader("What is the pose of two cameras, and how well can they match and measure?")

text, picture = st.columns([5, 6], gap="large")
with text:
    st.markdown(PURPOSE)
    samples = {"recording": ("Open the real recording", real_recording)}
    if has_sample_photographs():
        samples["demo_photographs"] = ("Sample photographs", sample_photographs)
    samples["demo"] = ("Simulated rig", sample_points)
    with st.container(horizontal=True):
        for key, (label, make) in samples.items():
            st.button(
                label, type="primary" if key == "recording" else "secondary", key=key,
                on_click=begin_sample, args=(projects_in_creation(), make),
            )  # fmt: skip
    if st.button("Start with my own data", key="begin"):
        forget_project()
        st.switch_page("pages/data.py")
with picture:
    st.image(str(PICTURE), width="stretch")

show_projects()

st.header("What to bring", divider="gray")
st.markdown(BRING)
