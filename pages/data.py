"""Data: upload of points, cameras and measured lengths."""

from stereocal.ui.menu import page_head

page_head("Data", "Which points did the cameras see, and what did you measure?")

import streamlit as st

from stereocal.ui.data_read import show_in_step, show_what_was_read
from stereocal.ui.door import data_door
from stereocal.ui.files_of_all import ask_about_files
from stereocal.ui.lengths import ask_lengths
from stereocal.ui.photographs import show_photographs
from stereocal.ui.project import current_project, forget_project
from stereocal.ui.windows import ask_windows

project = current_project()
data_door(project)
files = ask_about_files(project)
# Above the photographs: they may be all that is missing.
ask_lengths(project, files)
ask_windows(project)
show_photographs(project, files)
show_in_step(project)
show_what_was_read(current_project(), files)
st.button("Start a new project", on_click=forget_project, key="forget")
