"""Start: two ways to begin, the story on a real recording, recent projects, what you need."""

from stereocal.ui.menu import page_head

page_head("Two cameras, a bar, two lengths")

import streamlit as st

from stereocal.ui import start
from stereocal.ui.projects import show_projects, show_storage
from stereocal.ui.texts import NEEDED, PURPOSE

st.markdown(PURPOSE)
start.begin_buttons()
chart, beginnings = st.columns([3, 2], gap="large")
with chart:
    start.show_story()
with beginnings:
    st.markdown("**Or begin with**")
    start.other_beginnings()

project = show_projects()

st.markdown("#### What you need")
st.markdown(NEEDED)
show_storage(project)
