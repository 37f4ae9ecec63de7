"""Three cameras and more on the page Calibrate: their work, and the answer for all of them."""

from collections.abc import Callable, Mapping
from typing import Any

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures import rig_report
from stereocal.figures.space import view_names
from stereocal.fit.in_words import loops_sentence, rig_notes, rig_sentence, windows_sentence
from stereocal.fit.rig_file import RIG, RigFile
from stereocal.fit.start.pairs import pair_name
from stereocal.projects.data import PAIRS
from stereocal.projects.project import Project
from stereocal.system.made_from import Parts
from stereocal.system.numbers import count
from stereocal.system.tasks import Progress, StoppedError
from stereocal.system.zip_files import pack_zip
from stereocal.ui import jobs
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Field, choose, one_of, setting, yes_or_no
from stereocal.ui.figure import clicked_in, is_narrow, show_figure
from stereocal.ui.messages import callback, show_each
from stereocal.ui.texts import escape_markdown
from stereocal.verdict.in_words import digits, in_percent
from stereocal.workflow.made_from import DATA, WINDOWS
from stereocal.workflow.run import Run

GRAPH = "rig_graph"
ONE_RIG = "One rig of"
NOTES, TIME_OFFSETS = "rig_pairs_without_files", "rig_time_offsets"
TILES = ("Mean reprojection error", "95 % of lengths within", "Noise of an image point")


def run_of(
    project: Project,
    begin: Callable[[str], object] = lambda _: None,
    progress: Progress = lambda *_: None,
) -> Run | None:
    """The calibration of all cameras with the project's present data and settings; None without a
    recording.

    Args:
        begin, progress: as of `Run`.
    """
    if (recording := project.recording_in_use) is None:
        return None
    every = project.settings.get(TIME_OFFSETS) is True
    time_offsets = True if every else None  # None: those that are significant
    return Run(recording, time_offsets=time_offsets, begin=begin, progress=progress)


def rig_parts(project: Project) -> tuple[Parts, Parts]:
    """What the rig was made from, and would be made from now."""
    rig, run, made_from = project.rig, run_of(project), project.rig_made_from
    if rig is None or run is None:
        return {}, {}
    if made_from:
        in_air = {WINDOWS: list[Any]()}
        return in_air | {**made_from}, in_air | {**run.made_from}
    # An earlier version forgot a rig with everything that changed it.
    return {DATA: [rig.about.inputs.get("sha256")]}, {DATA: [run.recording.sha256]}


def rig_work(project: Project) -> jobs.PageWork:
    """The work of a press."""

    def work(job: jobs.Job) -> None:
        run = run_of(project, job.begin, job.progress)
        if run is None:
            raise StereocalError("This project holds no recording of several cameras.")
        rig, files = run.rig.dumps(), pack_zip(run.pair_files)
        recording = project.recording
        if recording is None or [*recording.cameras] != [*run.recording.cameras]:
            raise StoppedError  # another recording has been given
        project.keep_settings({NOTES: run.notes_on_pairs})
        project.keep_rig(rig, files, run.made_from)
        jobs.drop_pairs(project)

    return jobs.PageWork(project, "rig", ("steps", "pairs"), work)


def tell_not_calibrated() -> None:
    """Say that there is no rig yet, and link to where it is made."""
    st.info("The cameras are not calibrated yet.")
    st.page_link("pages/calibrate.py", label="Calibrate them on the page Calibrate")


def ask_time_offsets(project: Project) -> None:
    """Whether every time offset is applied."""
    title, hint = "Apply every time offset", "Else those that are significant are applied."
    st.toggle(title, help=hint, **setting(project, TIME_OFFSETS, False, yes_or_no).widget())


def show_rig(project: Project, rig: RigFile) -> None:
    """The answer for all cameras: how good they are, their files, and where they stand."""
    headline, _, rest = escape_markdown(rig_sentence(rig)).partition(ONE_RIG)
    st.success(f"**{headline.strip() or ONE_RIG + rest}**\n\n{(ONE_RIG + rest) * bool(headline)}")
    notes = [*rig_notes(rig), *project.settings.get(NOTES, [])]
    show_each(st.warning, notes[:1])
    if notes[1:]:
        with st.expander(count(len(notes[1:]), "more note")):
            show_each(st.warning, notes[1:])
    show_tiles(dict(zip(TILES, _tiles(rig), strict=True)))
    if windows := windows_sentence(rig):
        st.caption(escape_markdown(windows))
    with st.container(horizontal=True):
        offer("rig.json", rig.dumps(), RIG, "download_rig_json", primary=True)
        if project.pair_files is not None:
            offer("All pairs (zip)", project.pair_files, PAIRS, "rig_zip")
    st.subheader("The cameras in 3D")
    recording = project.recording_in_use
    view = choose(project, "view_of_all", "Seen from", view_names(rig), as_menu=True)
    figure = rig_report.plot_cameras(rig, recording, view, is_narrow())
    show_figure(figure, rig_report.describe_rig_graph(rig), "rig_cameras")


def show_tiles(tiles: Mapping[str, tuple[str, str]]) -> None:
    """A tile of each title, beside each other: its value, and words about it."""
    for (title, (value, words)), column in zip(tiles.items(), st.columns(len(tiles)), strict=True):
        with column, st.container(border=True):
            st.metric(title, value)
            st.caption(words)


def _tiles(rig: RigFile) -> list[tuple[str, str]]:
    """Value and words of each tile."""
    figures = rig.about.figures
    if figures is None:
        return [("unknown", "not in this file")] * len(TILES)
    expected, metric = figures.to_expect, figures.metric_error_p95
    scatter = expected.length_error_p95
    weakest = escape_markdown(figures.weakest_camera)
    alone = "" if scatter is None else f"relative to the object: {in_percent(scatter)}"
    return [
        (f"{digits(figures.reprojection_px, 2)} px", f"of all images of {figures.frames} frames"),
        ("unknown" if metric is None else in_percent(metric), alone or "no known length"),
        (f"{digits(rig.noise_px, 2)} px", f"weakest camera: {weakest}"),
    ]


def pair_field(project: Project, rig: RigFile) -> Field:
    """The pair whose two images the page is about."""
    names = project.pair_names or [pair_name((rig.names[0], rig.names[1]))]
    return setting(project, "pair", names[0], one_of(names), tabs_own=True)


def show_graph(project: Project, rig: RigFile) -> None:
    """The cameras from above with a line for each pair, which a click chooses; and their errors."""
    field = pair_field(project, rig)

    @callback
    def choose_clicked() -> None:
        if (pair := clicked_in(GRAPH)) in project.pair_names:  # None of a camera
            field.set(pair)

    graph, words = rig_report.plot_rig_graph(rig), rig_report.describe_rig_graph(rig)
    if project.pair != field.value():  # chosen here: the page is about another pair
        st.rerun()
    show_figure(graph, words, GRAPH, on_select=choose_clicked, selection_mode="points")
    st.caption("A click on a line chooses that pair.")
    if loops := loops_sentence(rig):
        st.caption(escape_markdown(loops))
    st.table(rig_report.camera_table(rig))
