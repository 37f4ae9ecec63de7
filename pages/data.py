"""Data: upload of points, cameras and two lengths."""

from stereocal.ui.menu import page_head

page_head("Data", "Which points did the cameras see, and what did you measure?")

from functools import partial

import streamlit as st

from stereocal.figures.coverage import describe_coverage, plot_coverage
from stereocal.figures.tables import contents_table
from stereocal.projects.given import ProjectGiven
from stereocal.projects.recording import ProjectRecording
from stereocal.system.numbers import count
from stereocal.ui import lengths
from stereocal.ui.all_cameras import show_files, show_recording
from stereocal.ui.door import data_door
from stereocal.ui.figure import show_figure
from stereocal.ui.holding import holds_board
from stereocal.ui.messages import ErrorsShown, end_here
from stereocal.ui.photographs import has_photographs, show_photographs
from stereocal.ui.prerequisites import is_asked
from stereocal.ui.project import current_project, forget_project
from stereocal.ui.results import COVERAGE, dataset_download, open_clicked_frame
from stereocal.ui.texts import escape_markdown

project = current_project()
of_rig = project is not None and project.pair is None and ProjectRecording(project).is_given
if project is not None and project.pair is not None:
    st.info(
        f"This is the pair {escape_markdown(project.pair)} of a rig: the points that both cameras "
        "saw and the rig was fitted to, with the lenses and the baseline of the rig. The refined "
        "set is the rig's; a frame that you leave out here is left out of this pair."
    )
else:
    data_door(project)
    if project is not None and of_rig:
        show_recording(project)
    elif project is not None and ProjectGiven(project).is_of_rig:
        show_files(project)
        end_here()
    else:
        show_photographs(project)

if not of_rig:
    left, right = st.columns(2)
    with left:
        lengths.length_field(project, "baseline_m", "Baseline: distance between the cameras")
        if project is not None and project.pair is None:
            lengths.offer_nominal_baseline(project)
        lengths.length_uncertainty(project, "baseline_m", "± 1 %")
    with right:
        if project is not None and has_photographs(project) and holds_board(project):
            st.markdown("The squares of the board are the measured lengths.")
        elif about := lengths.object_in_words(project):
            st.markdown(about)
        else:
            lengths.length_field(project, "target_distance_m", "Distance between targets A and B")
        lengths.length_uncertainty(project, "target_distance_m", "± 0.1 %")
    if project is not None:
        lengths.ask_if_measured(project)
    lengths.lens_uncertainties(project)

    project = current_project()
    if project is None or not (
        project.inputs.files or has_photographs(project) or is_asked(project)
    ):
        st.info(
            "Nothing is loaded yet. Give files above, or try the sample data on the Start page."
        )
        st.page_link("pages/start.py", label="Back to Start")
        end_here()

    with ErrorsShown(end=True):
        dataset = project.dataset
    if dataset is None:
        end_here()
    st.header("What was read", divider="gray")
    st.success(
        f"Complete: {count(len(dataset.correspondences), 'pair')} of points in "
        f"{count(len(dataset.correspondences.frames), 'frame')}."
    )
    lengths.show_rig(project, dataset)
    show_figure(
        plot_coverage(dataset),
        describe_coverage(dataset),
        COVERAGE,
        narrow=plot_coverage(dataset, narrow=True),
        on_select=partial(open_clicked_frame, project),
        selection_mode="points",
    )
    st.caption("A click on a point opens its frame.")
    st.table(contents_table(dataset))
    dataset_download(dataset)
st.button("Start a new project", on_click=forget_project, key="forget")
