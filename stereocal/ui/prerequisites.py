"""The project and data set that a page needs."""

import streamlit as st

from stereocal.projects.application import ProjectApplication
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.pair import Pair
from stereocal.rig.recording import REFINED_ONLY
from stereocal.ui.holding import holds_board
from stereocal.ui.lengths import ask_if_measured
from stereocal.ui.messages import button, end_here, readable
from stereocal.ui.photographs import has_photographs
from stereocal.ui.project import current_project, project_to_write
from stereocal.ui.rig import pair_field, tell_not_calibrated


def is_asked(project: Project) -> bool:
    """Whether a table, or a file of another program, waits for answers on Data."""
    store = ProjectApplication(project)
    return any(store.asking(slot) is not None for slot in ("bars", "archive"))


def missing_of(project: Project) -> str:
    """What a project still lacks for a calibration, in Markdown."""
    missing = ", ".join(project.inputs.missing)
    if not has_photographs(project):
        if ProjectApplication(project).asking("bars") is None:
            return missing
        return missing.replace("the table of points", "the points (of the table below)")
    if missing and holds_board(project):
        return "the boards in the photographs (press *Find the boards*)"
    targets = "the targets in the photographs (press *Find the targets*)"
    if readable(lambda: ProjectPhotographs(project).frames, warn=False) is not None:
        targets = "usable targets in both photographs (the frames on *Data* say why none are)"
    return missing.replace("the table of points", targets)


def project_or_begin(needs: str, key: str) -> Project:
    """The current project; without one, the page says what it needs, and stops."""
    project = current_project()
    if project is None:
        st.info(f"Before this page can answer, it needs {needs}.")
        st.page_link("pages/data.py", label="Calibrate first: give points on the Data page")
        button("I have both as files", key, project_to_write)
        end_here()
    return project


def project_with_data() -> Project:
    """The current project, whose data are complete.

    If an input is missing, the page names it, links to the Data page, and stops.
    """
    project = current_project()
    if project is None or not (project.is_rig or project.dataset):
        if project is not None:
            ask_if_measured(project)
        missing = missing_of(project) if project else "points, cameras and two lengths"
        st.info(f"Before this page can answer, it needs {missing}.")
        st.page_link("pages/data.py", label="Give them on the Data page")
        end_here()
    return project


def tell_no_pairs(project: Project) -> None:
    """Say that there are no sets of a pair, and stop, where cameras look through a window."""
    recording = project.recording if project.is_rig else None
    if recording is not None and recording.has_windows:
        st.info(
            f"The paper's two sets and their validation are for cameras in air: {REFINED_ONLY}, "
            "which *Calibrate* makes of all cameras."
        )
        if project.rig is not None:
            st.page_link("pages/apply.py", label="Match and measure with it on the Apply page")
        end_here()


def two_cameras_of(project: Project) -> tuple[Project, Pair]:
    """The project with the two cameras that the page is about, and their data: of three and more
    those that are chosen from a menu. Without a rig, the page says so, and stops."""
    if project.is_rig:
        tell_no_pairs(project)
        if (rig := project.rig) is None:
            tell_not_calibrated()
            end_here()
        field = pair_field(project, rig)
        field.menu("Pair of cameras", width=260)
        project = project.of_pair(field.value())
    dataset = project.dataset
    assert dataset is not None, "of complete data"
    return project, dataset
