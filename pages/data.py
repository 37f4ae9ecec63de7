"""Data: upload of points, cameras and two lengths."""

from stereocal.ui.menu import page_head

page_head("Data", "Which points did the cameras see, and what did you measure?")

import streamlit as st

from stereocal.projects.given import ProjectGiven
from stereocal.projects.recording import ProjectRecording
from stereocal.ui.all_cameras import show_files, show_recording
from stereocal.ui.data_read import show_in_step, show_what_was_read
from stereocal.ui.door import data_door
from stereocal.ui.holding import holds_board
from stereocal.ui.lengths import ask_lengths
from stereocal.ui.messages import end_here
from stereocal.ui.photographs import has_photographs, show_photographs
from stereocal.ui.project import current_project, forget_project
from stereocal.ui.texts import PAIR, escape_markdown

project = current_project()
pair = project.pair if project else None
of_rig = project is not None and pair is None and ProjectRecording(project).is_given
if pair is not None:
    st.info(PAIR.format(escape_markdown(pair)))
else:
    data_door(project)
    if project is not None and of_rig:
        show_recording(project)
    elif project is not None and ProjectGiven(project).is_of_rig:
        show_files(project)
        end_here()
    else:
        show_photographs(project)
if project is not None:
    show_in_step(project)
if not of_rig:
    ask_lengths(project, bool(project and has_photographs(project) and holds_board(project)))
    show_what_was_read(current_project())
st.button("Start a new project", on_click=forget_project, key="forget")
