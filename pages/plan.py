"""Plan: will a rig measure what is needed, before anybody drives to the field?"""

from stereocal.ui.menu import ensure_navigation

ensure_navigation()


import streamlit as st

from stereocal.ui.intake import show_refusal
from stereocal.ui.plan import open_plan, show_forecast
from stereocal.ui.plan_fields import plan_controls
from stereocal.ui.project import current_project

st.title("Plan")
st.subheader("Will this rig measure what I need?")

project = current_project()
with st.expander("Open a saved plan"):
    open_plan(project)
show_refusal()
show_forecast(project, plan_controls(project))
