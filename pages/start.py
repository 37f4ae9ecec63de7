"""Start: the story on a real recording, data to begin with, recent projects, what you need."""

from stereocal.ui.menu import page_head

page_head("Two cameras, a bar, two lengths")

import streamlit as st

from stereocal.ui import start
from stereocal.ui.project import forget_project
from stereocal.ui.projects import show_projects, show_storage
from stereocal.ui.texts import NEEDED, PURPOSE

st.markdown(PURPOSE)
start.show_story()

with st.container(horizontal=True):
    start.sample_buttons()
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
