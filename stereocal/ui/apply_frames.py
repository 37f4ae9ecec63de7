"""Matches and points of the Apply page, frame by frame: both images and space, and a player."""

from __future__ import annotations

import bisect
import time
from collections.abc import Sequence

import pandas as pd
import streamlit as st

from stereocal.figures.matches import describe_matches, plot_matches
from stereocal.figures.measured import TITLES, Colour, describe_points, plot_points
from stereocal.figures.photograph import Photograph
from stereocal.figures.space import VIEWS
from stereocal.matching.application import Outcome
from stereocal.matching.lengths import track_columns, tracks_by, usual_tracks
from stereocal.matching.pairs import pixels_of
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import IntArray
from stereocal.ui.apply_threshold import whole_table
from stereocal.ui.chosen_frame import NAME, frames_photographed, photographs_of
from stereocal.ui.fields import Field, choose, number, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import callback, fragment
from stereocal.ui.texts import escape_markdown

STEP_S = 0.5
"""Time of a frame while playing."""
NOTHING = "nothing"
_PLAYING = "apply_playing"
"""Time of the last step; absent while it is paused."""


def show_frames(
    project: Project,
    store: ProjectApplication,
    outcome: Outcome,
    pairs: pd.DataFrame,
    points: pd.DataFrame,
) -> None:
    """The matches of one frame in both images, and all points in space."""
    playing = _PLAYING in st.session_state
    draw = fragment(_draw, run_every=STEP_S if playing else None)
    draw(project, store, outcome, pairs, points, playing)


def _draw(
    project: Project,
    store: ProjectApplication,
    outcome: Outcome,
    pairs: pd.DataFrame,
    points: pd.DataFrame,
    playing: bool,
) -> None:
    if playing != (_PLAYING in st.session_state):
        st.rerun()  # the whole page: the timer is set where the fragment is called
    tables = [whole_table(store, name, name) for name in outcome.tables]
    frames = _frames(" ".join(outcome.tables), tables)
    frame = _choose_frame(project, store, outcome, frames)
    of_frame = pairs[pairs["frame"] == frame]
    first, second = (pixels_of(table[table["frame"] == frame]) for table in tables)
    photographs = _photographs(project, store, outcome, frames, frame)
    rig = outcome.rig
    images, space = st.columns(2)
    with images:
        for side, camera, seen, photograph in zip(
            CAMERAS, (rig.primary, rig.secondary), (first, second), photographs, strict=True
        ):
            st.markdown(f"**{side.capitalize()}**")
            figure = plot_matches(of_frame, seen, side, camera.image_size, photograph)
            st.plotly_chart(figure, key=f"matches_{side}")
        st.caption(escape_markdown(describe_matches(of_frame, first, second, frame)))
    with space:
        _show_space(project, outcome, points, None if playing else frame)


@st.cache_resource(show_spinner=False, max_entries=4)
def _frames(key: str, _tables: Sequence[pd.DataFrame]) -> list[int]:
    """The frames with points."""
    assert key
    both = {int(each) for table in _tables for each in table["frame"].unique()}
    return sorted(both)


def _frame_field(
    project: Project, store: ProjectApplication, outcome: Outcome, frames: list[int]
) -> Field:
    """The frame shown; the bar's own points have the frame that is chosen on all pages."""
    name = NAME if are_own(store, outcome) else "apply_frame"
    fit = number(frames[0], frames[-1])
    return setting(project, "apply_frame", frames[0], fit, name=name, tabs_own=True)


def are_own(store: ProjectApplication, outcome: Outcome) -> bool:
    """Whether a result is of the bar's own points."""
    given = store.points("primary")
    return given is None or given.name != outcome.tables[0]


def _choose_frame(
    project: Project, store: ProjectApplication, outcome: Outcome, frames: list[int]
) -> int:
    """A slider that plays."""
    if len(frames) == 1:
        return frames[0]
    field = _frame_field(project, store, outcome, frames)
    if time.monotonic() - st.session_state.get(_PLAYING, float("inf")) > 0.8 * STEP_S:
        _step(field, frames)
    slider, buttons = st.columns([3, 2], vertical_alignment="bottom")
    slider.slider("Frame", frames[0], frames[-1], **field.widget())
    frame = int(field.value())
    after, before = bisect.bisect_right(frames, frame), bisect.bisect_left(frames, frame) - 1
    with buttons, st.container(horizontal=True):
        for label, key, to in (("Previous", "p", before), ("Next", "n", after)):
            there = 0 <= to < len(frames)
            st.button(
                label,
                key=f"apply_{label.lower()}",
                shortcut=key,
                disabled=not there,
                on_click=callback(field.set),
                args=(frames[to] if there else None,),
            )
        _play_button(field, frames)
    return frame


def _step(field: Field, frames: list[int]) -> None:
    """The next frame with points, in this tab; at the last one the player stops."""
    at = bisect.bisect_right(frames, field.value())
    if at == len(frames):
        _pause()
        st.rerun()
    st.session_state[_PLAYING] = time.monotonic()
    field.show(frames[at])


def _play_button(field: Field, frames: list[int]) -> None:
    playing = _PLAYING in st.session_state
    st.button(
        "Pause" if playing else "Play",
        key="apply_play",
        width=110,
        shortcut="k",
        icon=":material/pause:" if playing else ":material/play_arrow:",
        on_click=_pause if playing else _play,
        args=() if playing else (field, frames),
    )


def _play(field: Field, frames: list[int]) -> None:
    st.session_state[_PLAYING] = time.monotonic()
    if field.value() >= frames[-1]:
        field.show(frames[0])


def _pause() -> None:
    st.session_state.pop(_PLAYING, None)


def _photographs(
    project: Project, store: ProjectApplication, outcome: Outcome, frames: list[int], frame: int
) -> tuple[Photograph | None, Photograph | None]:
    """Photographs of the frame, if the points are of the photographed frames."""
    if not are_own(store, outcome) and not set(frames) <= frames_photographed(project):
        return None, None
    sizes = [camera.image_size for camera in (outcome.rig.primary, outcome.rig.secondary)]
    first, second = (
        None if image is None or image.shape[::-1] != size else image
        for image, size in zip(photographs_of(project, frame), sizes, strict=True)
    )
    return first, second


def _show_space(
    project: Project, outcome: Outcome, points: pd.DataFrame, frame: int | None
) -> None:
    columns, usual = _track_columns(outcome.digest, points)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        view = choose(project, "apply_seen_from", "Seen from", VIEWS)
        with st.popover("Colour, lines"):
            colour: Colour = choose(
                project, "apply_colour", "Colour", TITLES, format_func=TITLES.__getitem__
            )
            title, ways = "Lines connect points of the same", [NOTHING, *columns]
            column: str = choose(
                project, "apply_tracks", title, ways, usual or NOTHING, as_menu=True
            )
    tracks = [] if column == NOTHING else _tracks(outcome.digest, column, points)
    figure = plot_points(points, colour, outcome.rig, view, tracks, frame, outcome.world)
    words = describe_points(points, tracks, outcome.world)
    show_figure(figure, words, "points", fold=False)


@st.cache_resource(show_spinner=False, max_entries=4)
def _track_columns(digest: str, _points: pd.DataFrame) -> tuple[list[str], str | None]:
    assert digest
    return track_columns(_points), usual_tracks(_points)


@st.cache_resource(show_spinner=False, max_entries=8)
def _tracks(digest: str, column: str, _points: pd.DataFrame) -> list[IntArray]:
    assert digest
    return tracks_by(_points, column)
