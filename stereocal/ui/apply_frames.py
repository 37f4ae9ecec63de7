"""Matches and points of the Apply page, frame by frame: both images and space, and a player."""

from __future__ import annotations

import bisect
import time
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import pandas as pd
import streamlit as st

from stereocal.figures.matches import describe_matches, plot_matches
from stereocal.figures.measured import TITLES, Colour, describe_points, plot_points
from stereocal.figures.space import VIEWS
from stereocal.matching.application import Outcome
from stereocal.matching.lengths import tracks_by
from stereocal.matching.pairs import pixels_of
from stereocal.projects.application import ProjectApplication
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS
from stereocal.rig.compiled import IntArray
from stereocal.ui.apply_threshold import whole_table
from stereocal.ui.chosen_frame import NAME, frames_photographed, photographs_of
from stereocal.ui.fields import Number, choose, setting
from stereocal.ui.figure import show_figure
from stereocal.ui.messages import callback, fragment
from stereocal.ui.texts import escape_markdown

STEP_S = 0.5
"""Time of a frame while playing."""
NOTHING = "nothing"
_PLAYING = "apply_playing"
"""Time of the last step; absent while it is paused."""


class Tables(NamedTuple):
    """The tables of a result, and what they say."""

    pairs: pd.DataFrame
    points: pd.DataFrame
    answer: str
    agreement: str | None
    """How many pairs have the same label in both cameras."""
    track_columns: list[str]
    """The columns that can name a track."""
    usual_tracks: str | None


def show_frames(store: ProjectApplication, outcome: Outcome, tables: Tables) -> None:
    """The matches of one frame in both images, and all points in space."""
    playing = _PLAYING in st.session_state
    draw = fragment(_draw, run_every=STEP_S if playing else None)
    draw(store, outcome, tables, playing)


def _draw(store: ProjectApplication, outcome: Outcome, result: Tables, playing: bool) -> None:
    if playing != (_PLAYING in st.session_state):
        st.rerun()  # the whole page: the timer is set where the fragment is called
    tables = [whole_table(name, name, store) for name in outcome.tables]
    frames = _frames(" ".join(outcome.tables), tables)
    frame = _choose_frame(store, outcome, frames)
    of_frame = result.pairs[result.pairs["frame"] == frame]
    seen = [pixels_of(table[table["frame"] == frame]) for table in tables]
    own = are_own(store, outcome) or set(frames) <= frames_photographed(store.project)
    photographs = photographs_of(store.project, frame) if own else (None, None)
    images, space = st.columns(2)
    with images:
        for side, pixels, photograph in zip(CAMERAS, seen, photographs, strict=True):
            st.markdown(f"**{side.capitalize()}**")
            size = getattr(outcome.rig, side).image_size
            fits = photograph is not None and photograph.shape[::-1] == size
            figure = plot_matches(of_frame, pixels, side, size, photograph if fits else None)
            st.plotly_chart(figure, key=f"matches_{side}")
        st.caption(escape_markdown(describe_matches(of_frame, seen[0], seen[1], frame)))
    with space:
        _show_space(store.project, outcome, result, None if playing else frame)


@st.cache_resource(show_spinner=False, max_entries=4)
def _frames(key: str, _tables: Sequence[pd.DataFrame]) -> list[int]:
    """The frames with points."""
    assert key
    return sorted({int(each) for table in _tables for each in table["frame"].unique()})


def are_own(store: ProjectApplication, outcome: Outcome) -> bool:
    """Whether a result is of the bar's own points."""
    given = store.points("primary")
    return given is None or given.name != outcome.tables[0]


def _choose_frame(store: ProjectApplication, outcome: Outcome, frames: list[int]) -> int:
    """A slider that plays; the bar's own points have the frame that is chosen on all pages."""
    if len(frames) == 1:
        return frames[0]
    key, bounds = "apply_frame", Number(frames[0], frames[-1])
    name = NAME if are_own(store, outcome) else key
    field = setting(store.project, key, frames[0], bounds, name=name, tabs_own=True)
    playing = _PLAYING in st.session_state
    if playing and time.monotonic() - st.session_state[_PLAYING] > 0.8 * STEP_S:
        at = bisect.bisect_right(frames, field.value())
        if at == len(frames):  # the last one with points
            _pause()
            st.rerun()
        st.session_state[_PLAYING] = time.monotonic()
        field.show(frames[at])
    slider, buttons = st.columns([3, 2], vertical_alignment="bottom")
    slider.slider("Frame", frames[0], frames[-1], **field.widget())
    frame = int(field.value())

    def play() -> None:
        st.session_state[_PLAYING] = time.monotonic()
        if field.value() >= frames[-1]:
            field.show(frames[0])

    after, before = bisect.bisect_right(frames, frame), bisect.bisect_left(frames, frame) - 1
    with buttons, st.container(horizontal=True):
        for label, to in (("Previous", before), ("Next", after)):
            there, key = 0 <= to < len(frames), label.lower()
            step, off = callback(partial(field.set, frames[to] if there else None)), not there
            st.button(label, f"apply_{key}", on_click=step, shortcut=key[0], disabled=off)
        label, icon, press = ("Pause", "pause", _pause) if playing else ("Play", "play_arrow", play)
        icon = f":material/{icon}:"
        st.button(label, "apply_play", on_click=press, shortcut="k", width=110, icon=icon)
    return frame


def _pause() -> None:
    st.session_state.pop(_PLAYING, None)


def _show_space(project: Project, outcome: Outcome, result: Tables, frame: int | None) -> None:
    points, usual = result.points, result.usual_tracks
    with st.container(horizontal=True, vertical_alignment="bottom"):
        view = choose(project, "apply_seen_from", "Seen from", VIEWS)
        with st.popover("Colour, lines"):
            titled = TITLES.__getitem__
            colour: Colour = choose(project, "apply_colour", "Colour", TITLES, format_func=titled)
            title, ways = "Lines connect points of the same", [NOTHING, *result.track_columns]
            column: str = choose(
                project, "apply_tracks", title, ways, usual or NOTHING, as_menu=True
            )
    tracks = [] if column == NOTHING else _tracks(outcome.digest, column, points)
    figure = plot_points(points, colour, outcome.rig, view, tracks, frame, outcome.world)
    words = describe_points(points, tracks, outcome.world)
    show_figure(figure, words, "points", fold=False)


@st.cache_resource(show_spinner=False, max_entries=8)
def _tracks(digest: str, column: str, _points: pd.DataFrame) -> list[IntArray]:
    assert digest
    return tracks_by(_points, column)
