"""Plan: will a rig measure what is needed, before anybody drives to the field?"""

from stereocal.ui.menu import ensure_navigation

ensure_navigation()


import streamlit as st

from stereocal.errors import StereocalError
from stereocal.ui.intake import escape_markdown, show_refusal
from stereocal.ui.plan import (
    compared_plans,
    forecast_of,
    open_plan,
    plan_downloads,
    show_answer,
    show_comparison,
    show_curves,
    show_details,
    show_places,
)
from stereocal.ui.plan_fields import plan_controls
from stereocal.ui.plan_project import start_button
from stereocal.ui.print_downloads import field_sheet_to_print, planned_targets_to_print
from stereocal.ui.project import current_project

st.title("Plan")
st.subheader("Will this rig measure what I need?")

project = current_project()
with st.expander("Open a saved plan"):
    open_plan(project)
show_refusal()
try:
    plan = plan_controls(project)
    found = forecast_of(plan)
    show_answer(found)
    show_places(project, found)
    others = compared_plans(project)
    show_curves(found, others)
    show_comparison(project, found, others)
    with st.container(horizontal=True):
        start_button(found)
        plan_downloads(found)
        field_sheet_to_print(plan)
    planned_targets_to_print(project, plan)
    show_details(found)
except StereocalError as error:
    st.error(escape_markdown(str(error)))
