"""Results of the Apply page: answer, frame by frame, downloads, and closer looks."""

import bisect
import shlex
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path, PurePosixPath
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.figures import measured
from stereocal.figures.matches import describe_matches, plot_matches
from stereocal.figures.space import VIEWS, view_names
from stereocal.figures.style import Photograph
from stereocal.matching import lengths, trajectories
from stereocal.matching.application import (
    POINTS,
    Application,
    Outcome,
    agreement,
    read_result,
    result_in_words,
)
from stereocal.matching.names import AUTO
from stereocal.matching.point_table import pixels_of
from stereocal.matching.trajectories import COORDINATES
from stereocal.matching.views import TRACKS
from stereocal.projects.application import USES, ProjectApplication, Use, is_of_clicks, slot_of
from stereocal.projects.files import StoredFile
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, camera_in_words
from stereocal.rig.lengths_in_words import as_held
from stereocal.system.latest import once_or_refused
from stereocal.system.numbers import count
from stereocal.ui.apply import ApplyInputs
from stereocal.ui.apply_points import OPTIONAL, whole_table
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, choose, choose_from_menu, one_of, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.frames import NAME, frames_photographed, photographs_of
from stereocal.ui.messages import ErrorsShown, button, fragment, readable, show_each, show_stale
from stereocal.ui.press import PAPER_SET_FOR
from stereocal.ui.texts import escape_markdown
from stereocal.ui.world import WORLD_FILE

TWO, NOTHING = "the two points of a frame", "nothing"
FIRST_ROWS = 8
STEP_S = 0.5
"""Time of a frame while playing."""
_PLAYING = "apply_playing"
"""Time of the last step; absent while it is paused."""


class Tables(NamedTuple):
    """The tables of a result, and what they say."""

    pairs: pd.DataFrame
    """What belongs together: `pairs.csv`, or `tracks.csv` of a rig."""
    points: pd.DataFrame
    answer: str
    agreement: str | None
    """How many pairs have the same label in both cameras."""
    track_columns: list[str]
    """The columns that can name a track."""
    usual_tracks: str | None


def show_application(
    project: Project, store: ProjectApplication, chosen: ApplyInputs | None
) -> None:
    """The last finished result, even if the form has changed since, and closer looks.

    One look at a time, or none; only what is shown is computed.
    """
    work = None if chosen is None else chosen.work
    result = store.result if chosen is None else store.result_of(chosen.is_clicked)
    tables = None
    looks: dict[str, Callable[[], None]] = {}
    if result is not None:
        is_clicked = chosen is not None and chosen.is_clicked
        tables = _show_result(project, store, *result, work, is_clicked)
    elif work is not None:
        st.info("No result yet.")
    if tables is not None and result is not None:
        # A length that is known of the points, if they are the bar's.
        known_m = project.inputs.target_distance_m if _are_own(store, result[0]) else None
        looks["A known length"] = partial(_show_lengths, project, tables.points, known_m)
    if chosen is not None and chosen.show_threshold is not None:
        looks["Threshold and depths"] = chosen.show_threshold
    if tables is not None and result is not None:
        looks["Tables"] = partial(_show_tables, tables, result[0].matched)
    if looks:
        field = setting(project, "apply_view", None, one_of([None, *looks]), tabs_own=True)
        if look := st.segmented_control("Look closer", list(looks), **field.widget("default")):
            looks[look]()
    if result is not None:
        _show_words(store, result[0], tables)


def _show_result(
    project: Project,
    store: ProjectApplication,
    outcome: Outcome,
    files: dict[str, StoredFile],
    work: Application | None,
    is_clicked: bool,
) -> Tables | None:
    """The answer, and its points frame by frame; in space alone where points are clicked, whose
    frames stand above."""
    if work is None:
        show_stale("points, parameters or threshold, which are not complete now")
    tables = None
    with ErrorsShown():
        matched, points = files[outcome.matched], files[POINTS]
        tables = once_or_refused(
            "points", f"{matched.name} {points.name}", partial(_read, matched, points)
        )
    if tables is None:
        button("Begin again", "forget_result", store.forget_result)
        return None
    where = "" if outcome.world is None else " Points are in the world frame."
    dataset = readable(lambda: project.dataset)
    answer = tables.answer if dataset is None else as_held(tables.answer, dataset)
    st.success(escape_markdown(answer + where))
    show_each(st.warning, outcome.notes)
    if is_clicked:
        fragment(_show_space)(project, outcome, tables, None)
    else:
        playing = _PLAYING in st.session_state
        fragment(_draw, STEP_S if playing else None)(store, outcome, tables, playing)
    with st.container(horizontal=True):
        for name in (outcome.matched, POINTS):
            offer(f"Download {name}", files[name].read_bytes, name, f"download_{name}")
    return tables


def _show_lengths(project: Project, points: pd.DataFrame, known_m: float | None) -> None:
    columns: list[str] = lengths.label_columns(points)
    ways = [*columns, *([TWO] if lengths.has_two_a_frame(points) else [])]
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
    title = "Distinguish points by"
    way = choose_from_menu(project, "apply_way", title, ways, place=left)
    length_m = setting(project, "apply_known", known_m, OPTIONAL).number_input(
        "Known length (m)", right, format="%.6g", placeholder="measured length"
    )
    ends = ("", "")
    if way != TWO:
        names = sorted(points[way].dropna().astype(str).unique(), key=by_number)
        left, right = st.columns(2)
        first = choose_from_menu(project, f"apply_from_{way}", "From", names, place=left)
        second = choose_from_menu(project, f"apply_to_{way}", "To", names, names[1], place=right)
        ends = (first, second)
    if length_m is None:
        st.info("Give the known length.")
        return
    with ErrorsShown():
        check = lengths.check_lengths(points, length_m, None if way == TWO else way, ends)
        st.success(escape_markdown(check.sentence()))
        show_figure(measured.plot_lengths(check), measured.describe_lengths(check), "lengths")


def _show_tables(tables: Tables, matched: str) -> None:
    headings = measured.IN_WORLD if COORDINATES in tables.points else measured.HEADINGS
    number = st.column_config.NumberColumn
    for name, table in ((matched, tables.pairs), (POINTS, tables.points)):
        st.caption(f"{name}: the first {min(FIRST_ROWS, len(table))} of {count(len(table), 'row')}")
        columns: dict[str, Any] = {**headings}
        for name, digits in measured.formats(table).items():
            columns[name] = number(headings.get(name, name), format=digits)
        st.dataframe(table.head(FIRST_ROWS), hide_index=True, column_config=columns)


def _show_words(store: ProjectApplication, outcome: Outcome, tables: Tables | None) -> None:
    """The result in words, and the commands that write the same files, with their input."""
    with st.expander("In words, and on the command line"):
        agreed = tables.agreement if tables else None
        for sentence in (*outcome.sentences, agreed, f"Made with: {outcome.made_with}"):
            if sentence:
                st.caption(escape_markdown(sentence))
        names = [
            f"{camera}{Path(table).suffix}"
            for camera, table in zip(outcome.cameras, outcome.tables, strict=True)
        ]
        files = [_parameter_file(outcome, use) for use in USES[: len(outcome.files) or None]]
        st.code(_commands(outcome, names, files), language="shell", wrap_lines=True)
        with st.container(horizontal=True):
            for table, name in zip(outcome.tables, names, strict=True):
                make = store.table(table).read_bytes
                offer(f"Download {name}", make, name, f"download_{name}")
            for use, file, name in zip(USES, outcome.files, files, strict=False):
                stored, (_, digest) = store.set_of(use), outcome.used.get(use, ("", ""))
                if name != file and stored and stored[1].digest == digest:
                    offer(f"Download {name}", stored[1].dumps, name, f"download_set_{use}")


def _parameter_file(outcome: Outcome, use: Use) -> str:
    """The file to match or to measure with: parameters of another program as `reconstruct` reads
    them."""
    if not outcome.files:  # of version 1.0
        return f"parameters_{outcome.used.get(use, [PAPER_SET_FOR[use]])[0]}.json"
    name = outcome.files[USES.index(use)]
    return name if name.lower().endswith(".json") else f"{PurePosixPath(name).stem}.json"


def _commands(outcome: Outcome, names: Sequence[str], files: Sequence[str]) -> str:
    """The commands that write the same files from point files of these names.

    Args:
        files: names of the parameter files.
    """
    sigma = "" if outcome.sigma_px is None else f" --sigma-px {outcome.sigma_px!r}"
    world = "" if outcome.world is None else f" --world {WORLD_FILE}"
    by_name = "" if outcome.names == AUTO else f" --names {outcome.names}"
    point_files = " ".join(
        shlex.quote(name if camera in CAMERAS else f"{camera}={name}")
        for camera, name in zip(outcome.cameras, names, strict=True)
    )
    files = [shlex.quote(name) for name in files]
    if outcome.matched == TRACKS:
        match, measure = f"--rig {files[0]}{sigma}{by_name}", f"--rig {files[0]}{world}{sigma}"
    else:
        near, far = outcome.depths_m
        depths = "" if far is None and not near else f" --depth {near:g} {far or 'inf'}"
        threshold = f"--threshold {outcome.threshold_px!r}"
        match = f"--parameters {files[0]} {threshold}{sigma}{depths}{by_name}"
        measure = f"--parameters {files[1]}{world}"
    return (
        f"python -m stereocal match {point_files} {match} --out {outcome.matched}\n"
        f"python -m stereocal reconstruct {outcome.matched} {measure} --out {POINTS}"
    )


def _read(*files: StoredFile) -> Tables:
    tables = []
    for file in files:
        table = pd.DataFrame()
        with suppress(ValueError):
            table = read_result(file.read_bytes())
        if "frame" not in table:
            raise StereocalError(f"{file.label} of the last result is damaged.")
        tables.append(table)
    pairs, points = tables
    return Tables(
        pairs,
        points,
        result_in_words(pairs, points),
        agreement(pairs),
        trajectories.track_columns(points),
        trajectories.usual_tracks(points),
    )


def _draw(store: ProjectApplication, outcome: Outcome, result: Tables, playing: bool) -> None:
    """The matches of one frame in both images, and all points in space."""
    if playing != (_PLAYING in st.session_state):
        st.rerun()  # the whole page: the timer is set where the fragment is called
    tables = [whole_table(name, name, store) for name in outcome.tables]
    numbers = partial(np.unique, np.concatenate([table["frame"] for table in tables]))
    frames = once_or_refused("points", f"{' '.join(outcome.tables)} frames", numbers).tolist()
    first = min(result.pairs["frame"].tolist(), default=frames[0])
    frame = _choose_frame(store, outcome, frames, first)
    of_frame = result.pairs[result.pairs["frame"] == frame]
    seen = {
        side: pixels_of(table[table["frame"] == frame])
        for side, table in zip(outcome.cameras, tables, strict=True)
    }
    is_own = _are_own(store, outcome) or set(frames) <= {*frames_photographed(store.project)}
    both = photographs_of(store.project, frame) if is_own else (None, None)
    photographs: dict[str, Photograph | None] = dict(zip(CAMERAS, both, strict=True))
    words = describe_matches(of_frame, seen, frame)
    images, space = st.columns(2)
    with images:
        for side, pixels in seen.items():
            size, photograph = outcome.rig.placed[side].camera.image_size, photographs.get(side)
            fits = photograph is not None and photograph.shape[::-1] == size
            if not fits and not len(pixels):
                continue  # an empty box
            title = side if side in CAMERAS else camera_in_words(side)
            st.markdown(f"**{escape_markdown(title[0].upper() + title[1:])}**")
            figure = plot_matches(of_frame, pixels, side, size, photograph if fits else None)
            show_figure(figure, words, f"matches_{side}")
        st.caption(escape_markdown(words))
    with space:
        _show_space(store.project, outcome, result, None if playing else frame)


def _are_own(store: ProjectApplication, outcome: Outcome) -> bool:
    """Whether a result is of the bar's own points."""
    if is_of_clicks(outcome):
        return False
    file = store.points(slot_of(outcome.cameras[0]))
    return file is None or file.name != outcome.tables[0]


def _choose_frame(
    store: ProjectApplication, outcome: Outcome, frames: list[int], first: int
) -> int:
    """A slider that plays; the bar's own points have the frame that is chosen on all pages.

    Args:
        frames: those with points; of another, the nearest is shown.
        first: shown until another is chosen.
    """
    if len(frames) == 1:
        return frames[0]
    key, bounds = "apply_frame", Number(frames[0], frames[-1])
    name = NAME if _are_own(store, outcome) else key
    field = setting(store.project, key, first, bounds, name=name, tabs_own=True)
    wanted = int(field.value())
    field.show(min(frames, key=lambda number: abs(number - wanted)))
    playing = _PLAYING in st.session_state
    if playing and time.monotonic() - st.session_state[_PLAYING] > 0.8 * STEP_S:
        next_index = bisect.bisect_right(frames, field.value())
        if next_index == len(frames):  # the last one with points
            _pause()
            st.rerun()
        st.session_state[_PLAYING] = time.monotonic()
        field.show(frames[next_index])
    slider, buttons = st.columns([3, 2], vertical_alignment="bottom")
    field.slider("Frame", slider)
    frame = int(field.value())

    def play() -> None:
        st.session_state[_PLAYING] = time.monotonic()
        if field.value() >= frames[-1]:
            field.show(frames[0])

    after, before = bisect.bisect_right(frames, frame), bisect.bisect_left(frames, frame) - 1
    with buttons, st.container(horizontal=True):
        for label, to in (("Previous", before), ("Next", after)):
            exists, key = 0 <= to < len(frames), label.lower()
            number = frames[to] if exists else None
            button(label, f"apply_{key}", field.set, number, shortcut=key[0], disabled=not exists)
        label, icon, act = ("Pause", "pause", _pause) if playing else ("Play", "play_arrow", play)
        button(label, "apply_play", act, icon=icon, shortcut="k", width=110)
    return frame


def _pause() -> None:
    st.session_state.pop(_PLAYING, None)


def _show_space(project: Project, outcome: Outcome, result: Tables, frame: int | None) -> None:
    points, usual = result.points, result.usual_tracks
    with st.container(horizontal=True, vertical_alignment="bottom"):
        views = view_names(outcome.rig)
        many = len(views) > len(VIEWS)  # as buttons they would be cut off on a narrow screen
        view = choose(project, "apply_seen_from", "Seen from", views, as_menu=many)
        with st.popover("Colour, lines"):
            titles, named = measured.TITLES, measured.TITLES.__getitem__
            colour: measured.Colour = choose(
                project, "apply_colour", "Colour", titles, format_func=named
            )
            title, ways = "Lines connect points of the same", [NOTHING, *result.track_columns]
            same = usual or NOTHING
            column = choose(project, "apply_tracks", title, ways, same, as_menu=True)
    find = partial(trajectories.tracks_by, points, column)
    key = f"{outcome.digest} tracks {column}"
    tracks = [] if column == NOTHING else once_or_refused("points", key, find)
    figure = measured.plot_points(points, colour, outcome.rig, view, tracks, frame, outcome.world)
    words = measured.describe_points(points, tracks, outcome.world)
    show_figure(figure, words, "points", caption=True)
