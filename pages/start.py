"""Start: what this is for, what to bring, and a way to try it."""

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.ui.frame import need_frame
from stereocal.ui.intake import escape_markdown
from stereocal.ui.project import forget_project
from stereocal.ui.projects import show_projects
from stereocal.ui.samples import has_sample_photographs, load_sample, load_sample_photographs
from stereocal.ui.texts import BRING, PICTURE, PURPOSE

need_frame()
st.title("stereocal")
st.subheader("How do two cameras stand to each other, and how well can they match and measure?")

text, picture = st.columns([5, 6], gap="large")
with text:
    st.markdown(PURPOSE)
    samples = {"demo": ("Try it with sample data", load_sample)}
    if has_sample_photographs():
        samples["demo_photographs"] = ("Try it with sample photographs", load_sample_photographs)
    with st.container(horizontal=True):
        chosen = [
            load
            for key, (label, load) in samples.items()
            if st.button(label, type="primary" if key == "demo" else "secondary", key=key)
        ]
    for load in chosen:
        try:
            load()
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
