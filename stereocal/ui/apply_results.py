"""Results of the Apply page: answer, figures, downloads, and closer looks."""

from __future__ import annotations

import io
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures.measured import HEADINGS, IN_WORLD, describe_lengths, plot_lengths
from stereocal.matching.application import PAIRS, POINTS, Application, Outcome, agreement, answer
from stereocal.matching.lengths import (
    check_lengths,
    has_two_a_frame,
    label_columns,
    track_columns,
    usual_tracks,
)
from stereocal.matching.reconstruction_files import COORDINATES
from stereocal.projects.application import USES, ProjectApplication
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.lengths_in_words import as_held
from stereocal.ui.apply import Chosen
from stereocal.ui.apply_frames import Tables, are_own, show_frames
from stereocal.ui.apply_threshold import OPTIONAL
from stereocal.ui.downloads import offer
from stereocal.ui.fields import choose_from_menu, one_of, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import ErrorsShown, callback, readable
from stereocal.ui.refined import PAPERS
from stereocal.ui.texts import escape_markdown
from stereocal.ui.world import WORLD_FILE

TWO = "the two points of a frame"
FIRST_ROWS = 8


def show_application(project: Project, store: ProjectApplication, chosen: Chosen | None) -> None:
    """The last finished result, even if the form has changed since, and closer looks.

    One look at a time, or none; only what is shown is computed.
    """
    work = None if chosen is None else chosen.work
    result, tables = store.result, None
    if result is not None:
        tables = _show_result(project, store, *result, work)
    elif work is not None:
        st.info("No result yet.")
    looks: dict[str, Callable[[], None]] = {}
    if tables is not None and result is not None:
        # A length that is known of the points, if they are the bar's.
        known_m = project.inputs.target_distance_m if are_own(store, result[0]) else None
        looks["A known length"] = partial(_show_lengths, project, tables.points, known_m)
    if chosen is not None:
        looks["Threshold and depths"] = chosen.show_threshold
    if tables is not None:
        looks["Tables"] = partial(_show_tables, tables)
    if looks:
        shown = setting(project, "apply_view", None, one_of([None, *looks]), tabs_own=True)
        if look := st.segmented_control("Look closer", list(looks), **shown.widget()):
            looks[look]()
    if result is not None:
        _show_words(store, result[0], tables)


def _show_result(
    project: Project,
    store: ProjectApplication,
    outcome: Outcome,
    files: dict[str, StoredFile],
    work: Application | None,
) -> Tables | None:
    if work is None or outcome.digest != work.digest:
        st.warning(
            "The points, the parameters or the threshold have changed since this result. It was "
            f"computed with: {escape_markdown(outcome.made_with)}"
        )
    tables = None
    with ErrorsShown():
        tables = _read(files[PAIRS].name, files[POINTS].name, files[PAIRS], files[POINTS])
    if tables is None:
        st.button("Begin again", on_click=callback(store.forget_result), key="forget_result")
        return None
    where = "" if outcome.world is None else " Points are in the world frame."
    dataset = readable(lambda: project.dataset)
    said = tables.answer if dataset is None else as_held(tables.answer, dataset)
    st.success(escape_markdown(said + where))
    for note in outcome.notes:
        st.warning(escape_markdown(note))
    show_frames(store, outcome, tables)
    with st.container(horizontal=True):
        for name in (PAIRS, POINTS):
            _download(files[name], name, primary=True)
    return tables


def _download(file: StoredFile, name: str, primary: bool = False) -> None:
    offer(f"Download {name}", file.read_bytes, name, f"download_{name}", primary=primary)


def _show_lengths(project: Project, points: pd.DataFrame, known_m: float | None) -> None:
    columns: list[str] = label_columns(points)
    ways = [*columns, *([TWO] if has_two_a_frame(points) else [])]
    if not ways:
        st.info(
            "To check a length, the point files need a column that names the points (such as a "
            "track's number), or frames with two points."
        )
        return

    def by_number(name: str) -> tuple[float, str]:
        with suppress(ValueError):
            return float(name), name
        return float("inf"), name

    left, right = st.columns(2)
    title = "Points are told apart by"
    way = choose_from_menu(project, "apply_way", title, ways, place=left)
    known = setting(project, "apply_known", known_m, OPTIONAL).number_input(
        "Known length (m)", right, format="%.6g", placeholder="measured length"
    )
    ends = ("", "")
    if way != TWO:
        names = sorted(points[way].dropna().astype(str).unique(), key=by_number)
        left, right = st.columns(2)
        first = choose_from_menu(project, f"apply_from_{way}", "From", names, place=left)
        second = choose_from_menu(project, f"apply_to_{way}", "To", names, names[1], place=right)
        ends = (first, second)
    if known is None:
        st.info("Give the known length.")
        return
    with ErrorsShown():
        check = check_lengths(points, known, None if way == TWO else way, ends)
        st.success(escape_markdown(check.sentence()))
        show_figure(plot_lengths(check), describe_lengths(check), "lengths")


def _show_tables(tables: Tables) -> None:
    headings = IN_WORLD if COORDINATES in tables.points else HEADINGS
    for name, table in ((PAIRS, tables.pairs), (POINTS, tables.points)):
        st.caption(f"{name}: the first {min(FIRST_ROWS, len(table))} of {len(table)} rows")
        st.dataframe(table.head(FIRST_ROWS), hide_index=True, column_config={**headings})


def _show_words(store: ProjectApplication, outcome: Outcome, tables: Tables | None) -> None:
    """The result in words, and the commands that write the same files, with their input."""
    with st.expander("In words, and on the command line"):
        agreed = tables.agreement if tables else None
        for sentence in (*outcome.sentences, agreed, f"Made with: {outcome.made_with}"):
            if sentence:
                st.caption(escape_markdown(sentence))
        near, far = outcome.depths_m
        depths = "" if far is None and not near else f" --depth {near:g} {far or 'inf'}"
        sigma = "" if outcome.sigma_px is None else f" --sigma-px {outcome.sigma_px!r}"
        suffixes = [Path(name).suffix for name in outcome.tables]
        names = [f"{which}{end}" for which, end in zip(CAMERAS, suffixes, strict=True)]
        match_with, measure_with = (
            f"parameters_{outcome.used.get(use, [PAPERS[use]])[0]}.json" for use in USES
        )
        st.code(
            f"python -m stereocal match {names[0]} {names[1]} --parameters {match_with} "
            f"--threshold {outcome.threshold_px!r}{sigma}{depths} --out {PAIRS}\n"
            f"python -m stereocal reconstruct {PAIRS} --parameters {measure_with} "
            f"{'' if outcome.world is None else f'--world {WORLD_FILE} '}--out {POINTS}",
            language="shell",
            wrap_lines=True,
        )
        with st.container(horizontal=True):
            for table, name in zip(outcome.tables, names, strict=True):
                _download(store.table(table), name)


@st.cache_resource(show_spinner=False, max_entries=4)
def _read(pairs_digest: str, points_digest: str, _pairs: StoredFile, _points: StoredFile) -> Tables:
    assert pairs_digest and points_digest
    tables = []
    for name, file in ((PAIRS, _pairs), (POINTS, _points)):
        table = pd.DataFrame()
        with suppress(ValueError):
            table = pd.read_csv(io.BytesIO(file.read_bytes()))
        if "frame" not in table:
            raise StereocalError(f"{name} of the last result is damaged.")
        tables.append(table)
    pairs, points = tables
    tracks = track_columns(points), usual_tracks(points)
    return Tables(pairs, points, answer(pairs, points), agreement(pairs), *tracks)
