"""Plan: will a rig measure what is needed, before anybody drives to the field?"""

from stereocal.ui.menu import page_head

page_head("Plan", "Will this rig measure what I need?")

import streamlit as st

from stereocal.ui.messages import show_refusal
from stereocal.ui.plan import open_plan, show_forecast
from stereocal.ui.plan_fields import plan_controls
from stereocal.ui.project import current_project

project = current_project()
with st.expander("Open a saved plan"):
    open_plan(project)
show_refusal()
show_forecast(project, plan_controls(project))
