"""Results of the Apply page: answer, downloads, matches, points, a known length."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures import (
    describe_lengths,
    describe_matches,
    describe_points,
    plot_lengths,
    plot_matches,
    plot_points,
)
from stereocal.figures.measured import Colour
from stereocal.matching.application import PAIRS, POINTS, Application, Outcome, agreement
from stereocal.matching.lengths import check_lengths, has_two_a_frame, label_columns
from stereocal.matching.pairs import pixels_of
from stereocal.projects.application import ProjectApplication
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.ui.apply import whole_table
from stereocal.ui.downloads import on_demand
from stereocal.ui.fields import number, one_of, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.intake import escape_markdown
from stereocal.ui.messages import callback

TWO = "the two points of a frame"
FIRST_ROWS = 10
SCROLLS = """<style>
.st-key-matches_scroll { overflow-x: auto; }
.st-key-matches_scroll > div { min-width: 46rem; }
</style>"""
"""On a narrow screen the two images scroll sideways."""


def show_application(project: Project, store: ProjectApplication, work: Application | None) -> None:
    """The last finished result, even if the form has changed since."""
    result = store.result
    if result is None:
        if work is not None:
            st.info("No result yet.")
        return
    outcome, files = result
    st.header("Result", divider="gray")
    if work is None or outcome.digest != work.digest:
        st.warning(
            "The points, the parameters or the threshold have changed since this result. It was "
            f"computed with: {escape_markdown(outcome.made_with)}"
        )
    try:
        pairs, points = (_read(files[name].name, name, files[name]) for name in (PAIRS, POINTS))
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        st.button("Begin again", on_click=callback(store.forget_result), key="forget_result")
        return
    sentences = [*outcome.sentences, *([same] if (same := agreement(pairs)) else [])]
    st.success(escape_markdown(" ".join(sentences)))
    for note in outcome.notes:
        st.warning(escape_markdown(note))
    for name, column in zip((PAIRS, POINTS), st.columns(2), strict=True):
        _download(column, files[name], name)
    views = {
        "Matches in the images": lambda: _show_matches(store, outcome, pairs),
        "Points in 3D": lambda: _show_points(project, outcome, points),
        "A known length": lambda: _show_lengths(project, points),
        "Tables": lambda: _show_tables(pairs, points),
    }
    shown = setting(project, "apply_view", next(iter(views)), one_of(list(views)), tabs_own=True)
    view = st.segmented_control("Look at", list(views), required=True, **shown.widget())
    views[view]()
    st.caption(f"Made with: {escape_markdown(outcome.made_with)}")
    _show_commands(store, outcome)


def _download(place: Any, file: StoredFile, name: str) -> None:
    place.download_button(
        f"Download {name}", on_demand(file.read_bytes, name, "text/csv"), name, "text/csv",
        on_click="ignore", icon=":material/download:", key=f"download_{name}",
        type="primary" if name in (PAIRS, POINTS) else "secondary",
    )  # fmt: skip


def _show_matches(store: ProjectApplication, outcome: Outcome, pairs: pd.DataFrame) -> None:
    tables = [whole_table(store, name, name) for name in outcome.tables]
    frames = sorted(set(tables[0]["frame"]) | set(tables[1]["frame"]))
    frames = [int(each) for each in frames]
    frame = frames[0]
    if len(frames) > 1:
        looked_at = setting(store.project, "apply_frame", frames[0], one_of(frames), tabs_own=True)
        frame = st.select_slider("Frame", frames, **looked_at.widget())
    of_frame = pairs[pairs["frame"] == frame]
    first, second = (pixels_of(table[table["frame"] == frame]) for table in tables)
    (width, height), (width_2, height_2) = outcome.image_sizes
    figure = plot_matches(of_frame, first, second, ((width, height), (width_2, height_2)))
    st.html(SCROLLS)
    with st.container(key="matches_scroll"):
        st.plotly_chart(figure, key="matches")
    st.caption(escape_markdown(describe_matches(of_frame, first, second, frame)))


def _show_points(project: Project, outcome: Outcome, points: pd.DataFrame) -> None:
    colours: list[Colour] = ["frame", "error"]
    by = setting(project, "apply_colour", "frame", one_of(colours), tabs_own=True)
    colour = st.segmented_control(
        "Colour", colours, required=True,
        format_func={"frame": "By frame", "error": "By error"}.__getitem__, **by.widget(),
    )  # fmt: skip
    figure = plot_points(points, colour, np.array(outcome.secondary_m))
    show_figure(figure, describe_points(points), "points")


def _show_lengths(project: Project, points: pd.DataFrame) -> None:
    columns: list[str] = label_columns(points)
    ways = [*columns, *([TWO] if has_two_a_frame(points) else [])]
    if not ways:
        st.info(
            "To check a length, the point files need a column that names the points (such as a "
            "track's number), or frames with two points."
        )
        return
    left, right = st.columns(2)
    way = left.selectbox(
        "Points are told apart by", ways,
        **setting(project, "apply_way", ways[0], one_of(ways)).widget(),
    )  # fmt: skip
    bar_m = project.inputs.target_distance_m
    length = setting(project, "apply_known", bar_m, number(0.0, or_none=True))
    known = right.number_input(
        "Known length (m)", min_value=0.0, value=None, format="%.6g",
        placeholder="measured length", **length.widget(),
    )  # fmt: skip
    ends = ("", "")
    if way != TWO:
        names = sorted(points[way].dropna().astype(str).unique(), key=_by_number)
        first, second = (
            column.selectbox(
                title, names,
                **setting(project, f"apply_{title.lower()}_{way}", name, one_of(names)).widget(),
            )
            for title, name, column in zip(
                ("From", "To"), names[:1] + names[1:2], st.columns(2), strict=True
            )
        )  # fmt: skip
        ends = (first, second)
    if known is None:
        st.info("Give the known length.")
        return
    try:
        check = check_lengths(points, known, None if way == TWO else way, ends)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        return
    st.success(escape_markdown(check.sentence()))
    show_figure(plot_lengths(check), describe_lengths(check), "lengths")


def _show_tables(pairs: pd.DataFrame, points: pd.DataFrame) -> None:
    for name, table in ((PAIRS, pairs), (POINTS, points)):
        st.caption(f"{name}: the first {min(FIRST_ROWS, len(table))} of {len(table)} rows")
        st.dataframe(table.head(FIRST_ROWS), hide_index=True)


def _show_commands(store: ProjectApplication, outcome: Outcome) -> None:
    """The commands that write the same files, and their input tables."""
    with st.expander("The same on the command line"):
        near, far = outcome.depths_m
        depths = "" if far is None and not near else f" --depth {near:g} {far or 'inf'}"
        suffixes = [Path(name).suffix for name in outcome.tables]
        names = [f"{which}{end}" for which, end in zip(CAMERAS, suffixes, strict=True)]
        st.code(
            f"python -m stereocal match {names[0]} {names[1]} --parameters parameters_2d.json "
            f"--threshold {outcome.threshold_px!r}{depths} --out {PAIRS}\n"
            f"python -m stereocal reconstruct {PAIRS} --parameters parameters_3d.json "
            f"--out {POINTS}",
            language="shell", wrap_lines=True,
        )  # fmt: skip
        for table, name, column in zip(outcome.tables, names, st.columns(2), strict=True):
            _download(column, store.table(table), name)


@st.cache_resource(show_spinner=False, max_entries=4)
def _read(digest: str, name: str, _file: StoredFile) -> pd.DataFrame:
    """A table of a result."""
    assert digest
    try:
        table = pd.read_csv(io.BytesIO(_file.read_bytes()))
    except ValueError as error:
        raise StereocalError(f"{name} of the last result is damaged.") from error
    if "frame" not in table:
        raise StereocalError(f"{name} of the last result is damaged.")
    return table


def _by_number(name: str) -> tuple[float, str]:
    try:
        return float(name), name
    except ValueError:
        return float("inf"), name
