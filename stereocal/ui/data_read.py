"""What was read of two cameras, at the end of the Data page."""

from functools import partial

import streamlit as st

from stereocal.figures.coverage import describe_coverage, plot_coverage
from stereocal.figures.tables import contents_table
from stereocal.projects.project import Project
from stereocal.system.numbers import count
from stereocal.ui.figure import show_figure
from stereocal.ui.lengths import show_rig
from stereocal.ui.messages import ErrorsShown, end_here
from stereocal.ui.photographs import has_photographs
from stereocal.ui.prerequisites import is_asked
from stereocal.ui.results import COVERAGE, dataset_download, open_clicked_frame
from stereocal.ui.screen import is_narrow


def show_what_was_read(project: Project | None) -> None:
    """The rig in words, where its points are, and what they are; ends the page without them."""
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
    show_rig(project, dataset)
    figure, words = plot_coverage(dataset, is_narrow()), describe_coverage(dataset)
    clicked = partial(open_clicked_frame, project)
    show_figure(figure, words, COVERAGE, on_select=clicked, selection_mode="points")
    st.caption("A click on a point opens its frame.")
    st.table(contents_table(dataset))
    dataset_download(dataset)
