"""Start: what this is for, what to bring, and a way to try it."""

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.ui.frame import need_frame
from stereocal.ui.intake import escape_markdown, load_sample
from stereocal.ui.project import forget_project
from stereocal.ui.projects import show_projects
from stereocal.ui.texts import BRING, PICTURE, PURPOSE

need_frame()
st.title("stereocal")
st.subheader("How do two cameras stand to each other, and how well can they match and measure?")

text, picture = st.columns([5, 6], gap="large")
with text:
    st.markdown(PURPOSE)
    if st.button("Try it with sample data", type="primary", key="demo"):
        try:
            load_sample()
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
        else:
            st.switch_page("pages/data.py")
    if st.button("Begin with my own data", key="begin"):
        forget_project()
        st.switch_page("pages/data.py")
with picture:
    st.image(str(PICTURE), width="stretch")

show_projects()

st.header("What to bring", divider="gray")
st.markdown(BRING)
