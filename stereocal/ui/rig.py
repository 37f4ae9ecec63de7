"""The Rig page: all cameras of a recording together."""

from __future__ import annotations

from functools import partial

import numpy as np
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures.rig_report import (
    camera_table,
    describe_rig_graph,
    plot_cameras,
    plot_rig_graph,
)
from stereocal.network.calibrate import calibrate_rig
from stereocal.network.in_words import loops_sentence, rig_notes, rig_sentence
from stereocal.network.rig_file import RIG, RigFile, rig_file
from stereocal.network.unknowns import RigSettings
from stereocal.pairs_of_rig import files_of_pairs
from stereocal.projects.project import Project
from stereocal.projects.recording import PAIRS, ProjectRecording
from stereocal.rig.recording import Recording
from stereocal.system.zip_files import pack_zip
from stereocal.ui import jobs
from stereocal.ui.downloads import offer
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import callback
from stereocal.ui.navigation import go_to
from stereocal.ui.project import open_project
from stereocal.ui.screening import calibrate_next
from stereocal.ui.texts import escape_markdown

KIND: jobs.Kind = "rig"
STAGES = ("steps",)
GRAPH = "rig_graph"
TIME_OFFSETS = "rig_time_offsets"


class _CancelledError(Exception):
    """A person has cancelled the job."""


def work_of(project: Project, time_offsets: bool) -> jobs.Work:
    """The work of a press."""
    store = ProjectRecording(project)
    about = {"recording": store.digest, "time_offsets": time_offsets}

    def run(job: jobs.Job) -> bool:
        job.begin("steps")
        recording = store.read()
        if recording is None:
            raise StereocalError("This project holds no recording of several cameras.")

        def report(done: int, total: int) -> None:
            job.progress(done, total)
            if job.cancelled:
                raise _CancelledError

        try:
            rig = calibrate_rig(recording, RigSettings(time_offsets=time_offsets), report)
        except _CancelledError:
            return False
        found = rig_file(rig)
        files, _, _ = files_of_pairs(recording, found)
        store.keep_rig(found.dumps(), pack_zip(files))
        return True

    return jobs.Work(project, KIND, STAGES, about, run)


def show_rig_page(project: Project, recording: Recording) -> None:
    """The press, and the rig if there is one."""
    store = ProjectRecording(project)
    rig = store.rig
    left, right = st.columns([1, 2], vertical_alignment="center")
    with right:
        offsets = st.toggle(
            "The cameras may be out of step by fractions of a frame", key=TIME_OFFSETS
        )
    work = work_of(project, offsets)
    with left:
        jobs.start_button(work, "Calibrate all again" if rig else "Calibrate all", "rig_run")
    jobs.show_job(project, KIND, "Cancelled. The last result, if any, is unchanged.", work)
    if rig is None:
        count = len(recording.cameras)
        st.info(
            f"{count} cameras, {len({*recording.frame.tolist()})} frames. "
            f"{escape_markdown(recording.describe_pairs())}"
        )
        return
    _show_rig(store, rig)


def _show_rig(store: ProjectRecording, rig: RigFile) -> None:
    st.success(escape_markdown(rig_sentence(rig)))
    with st.container(horizontal=True):
        offer("rig.json", rig.dumps(), RIG, "rig_json")
        if store.pairs is not None:
            offer("All pairs (zip)", store.pairs, PAIRS, "rig_zip")
    show_figure(
        plot_rig_graph(rig),
        describe_rig_graph(rig),
        GRAPH,
        on_select=partial(_open_clicked, store),
        selection_mode="points",
    )
    st.caption("A click on a line opens that pair.")
    if loops := loops_sentence(rig):
        st.caption(escape_markdown(loops))
    for note in rig_notes(rig):
        st.warning(escape_markdown(note))
    names = list(rig.about["pairs"])
    with st.container(horizontal=True, vertical_alignment="bottom"):
        chosen = st.selectbox("A pair by itself", names, key="rig_pair")
        st.button(
            "Open this pair",
            key="rig_open_pair",
            on_click=_open_pair,
            args=(store, chosen),
            help="on all other pages: the bars that both cameras saw, with the rig's lenses",
        )
    st.header("The cameras", divider="gray")
    show_figure(plot_cameras(rig), describe_rig_graph(rig), "rig_cameras")
    st.table(camera_table(rig))


@callback
def _open_pair(store: ProjectRecording, name: str) -> None:
    """Open the pages of a pair, and calibrate it the first time (a callback)."""
    pair = store.pair(name)
    open_project(pair.id, name)
    go_to("calibrate")
    if pair.calibration is None:
        calibrate_next()


@callback
def _open_clicked(store: ProjectRecording) -> None:
    """Open the pair whose line was clicked (a callback)."""
    for point in st.session_state[GRAPH]["selection"]["points"]:
        if "customdata" in point:  # not a camera
            _open_pair(store, str(np.ravel(point["customdata"])[0]))
            return
