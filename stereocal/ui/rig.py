"""The Rig page: all cameras of a recording together, and buttons that open one of its pairs."""

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures import rig_report
from stereocal.fit.in_words import loops_sentence, rig_notes, rig_sentence
from stereocal.fit.rig_file import RIG, RigFile
from stereocal.projects.project import Project
from stereocal.projects.recording import PAIRS, ProjectRecording
from stereocal.system.numbers import count
from stereocal.system.zip_files import pack_zip
from stereocal.ui import jobs
from stereocal.ui.downloads import offer
from stereocal.ui.figure import clicked_in, show_figure
from stereocal.ui.messages import button, callback, end_here
from stereocal.ui.navigation import go_to
from stereocal.ui.project import current_project, open_project
from stereocal.ui.screening import calibrate_next
from stereocal.ui.texts import escape_markdown
from stereocal.workflow.run import Run

KIND: jobs.Kind = "rig"
GRAPH = "rig_graph"
TIME_OFFSETS = "rig_time_offsets"
NOTES = "rig_pairs_without_files"
OPENED = "The bars that both cameras saw, with the rig's lenses and baseline."


def rig_work(project: Project, time_offsets: bool) -> jobs.PageWork:
    """The work of a press."""
    store = ProjectRecording(project)

    def run(job: jobs.Job) -> None:
        recording = store.read()
        if recording is None:
            raise StereocalError("This project holds no recording of several cameras.")
        late = time_offsets or None
        found = Run(recording, late=late, begin=job.begin, progress=job.progress)
        rig, files = found.rig.dumps(), pack_zip(found.pair_files)
        project.keep_settings({NOTES: found.notes_on_pairs})
        store.keep_rig(rig, files)

    return jobs.PageWork(project, KIND, ("steps", "pairs"), run)


def show_page() -> None:
    """The press, and the rig if there is one."""
    project = current_project()
    store = None if project is None else ProjectRecording(project)
    recording = None if store is None else store.read()
    if project is None or store is None or recording is None:
        st.info(
            "This page is for recordings of three cameras and more: give their files on the Data "
            "page."
        )
        st.page_link("pages/data.py", label="Give it on the Data page")
        end_here()
    rig = store.rig
    left, right = st.columns([1, 2], vertical_alignment="center")
    title, told = "Apply every time offset", "Else those that are significant are applied."
    work = rig_work(project, right.toggle(title, key=TIME_OFFSETS, help=told))
    with left:
        label = "Calibrate all again" if rig else "Calibrate all"
        jobs.start_button(work, label, "rig_run", primary=rig is None)
    jobs.show_job(project, KIND, "Cancelled. The last result, if any, is unchanged.")
    if rig is None:
        frames = count(len({*recording.frame.tolist()}), "frame")
        pairs = escape_markdown(recording.describe_pairs())
        st.info(f"{len(recording.cameras)} cameras, {frames}. {pairs}")
        end_here()
    _show_rig(store, rig)


def _show_rig(store: ProjectRecording, rig: RigFile) -> None:
    st.success(escape_markdown(rig_sentence(rig)))
    with st.container(horizontal=True):
        offer("rig.json", rig.dumps(), RIG, "rig_json")
        if store.pairs is not None:
            offer("All pairs (zip)", store.pairs, PAIRS, "rig_zip")

    @callback
    def open_clicked() -> None:
        if (pair := clicked_in(GRAPH)) is not None:  # None of a camera
            open_pair(store, pair)

    graph, words = rig_report.plot_rig_graph(rig), rig_report.describe_rig_graph(rig)
    show_figure(graph, words, GRAPH, on_select=open_clicked, selection_mode="points")
    st.caption("A click on a line opens that pair.")
    if loops := loops_sentence(rig):
        st.caption(escape_markdown(loops))
    for note in [*rig_notes(rig), *store.project.settings.get(NOTES, [])]:
        st.warning(escape_markdown(note))
    st.caption("A pair by itself, on the pages Calibrate and Validate:")
    pair_buttons(store.project)
    st.header("The cameras", divider="gray")
    show_figure(rig_report.plot_cameras(rig), words, "rig_cameras")
    st.table(rig_report.camera_table(rig))


def pair_buttons(project: Project, page: str = "calibrate") -> None:
    """A button for each pair that shares bars.

    Args:
        page: what it opens.
    """
    store = ProjectRecording(project)
    with st.container(horizontal=True):
        for name in store.pair_names:
            key, shown = f"open_pair_{name}", f"Pair {escape_markdown(name)}"
            button(shown, key, open_pair, store, name, page, help=OPENED)


def open_pair(store: ProjectRecording, name: str, page: str = "calibrate") -> None:
    """Open a page of a pair; Calibrate calibrates it the first time (a callback)."""
    pair = store.pair(name)
    open_project(pair.id, name)
    if page == "calibrate" and pair.calibration is None:
        calibrate_next()
    go_to(page)
