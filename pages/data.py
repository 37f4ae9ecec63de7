"""Data: upload of points, cameras and two lengths."""

from stereocal.ui.menu import page_head

page_head("Data", "Which points did the cameras see, and what did you measure?")

import streamlit as st

from stereocal.projects.given import ProjectGiven
from stereocal.ui.all_cameras import show_all_cameras
from stereocal.ui.data_read import show_in_step, show_what_was_read
from stereocal.ui.door import data_door
from stereocal.ui.lengths import ask_lengths
from stereocal.ui.photographs import show_photographs
from stereocal.ui.project import current_project, forget_project

project = current_project()
data_door(project)
if project is not None and (project.is_rig or ProjectGiven(project).is_of_rig):
    show_all_cameras(project)
    show_in_step(project)
else:
    # Above the photographs: they may be all that is missing.
    ask_lengths(project)
    show_photographs(project)
    if project is not None:
        show_in_step(project)
    show_what_was_read(current_project())
st.button("Start a new project", on_click=forget_project, key="forget")
