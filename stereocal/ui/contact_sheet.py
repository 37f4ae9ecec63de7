"""Contact sheet of all frames: cutouts around the targets, with their standard errors."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import streamlit as st

from stereocal.frames.frame import STATES, Frame, describe_frames
from stereocal.frames.review import is_undecided
from stereocal.frames.review import use_frame as decide
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review, thumbnail
from stereocal.ui.fields import Number, choose, setting
from stereocal.ui.messages import refusing
from stereocal.ui.texts import escape_markdown

Item = TypeVar("Item")
ON_A_SHEET = 12
COLUMNS = 3
BADGES = {
    "found": (":material/check:", "green"),
    "doubtful": (":material/question_mark:", "orange"),
    "refused": (":material/close:", "red"),
}


def show_contact_sheet(
    store: ProjectPhotographs,
    frames: Sequence[Frame],
    running: bool,
    look_closely: Callable[[int], None],
) -> None:
    """The frames, twelve on a sheet; each can be used, left out, or opened."""
    st.info(describe_frames(frames))
    groups: dict[str, list[Frame]] = {
        "All": list(frames),
        "To decide": [frame for frame in frames if is_undecided(frame)],
        **{state.capitalize(): [f for f in frames if f.state == state] for state in STATES},
    }
    groups = {name: group for name, group in groups.items() if group or name == "All"}
    counted = {name: f"{name} ({len(group)})" for name, group in groups.items()}
    chosen = choose(store.project, "sheet_kind", "Show", groups, format_func=counted.__getitem__)
    on_a_sheet(store.project, groups[chosen], partial(_show_frame, store, running, look_closely))
    st.caption(
        "Each picture: the primary camera on the left, the secondary on the right; A green, B "
        "pink. Sigma is the standard error of a centre."
    )


def on_a_sheet(
    project: Project, items: Sequence[Item], show: Callable[[Item], None], key: str = "sheet"
) -> None:
    """Twelve of the items, in columns, and which twelve."""
    sheets = -(-len(items) // ON_A_SHEET)
    sheet = 1
    if sheets > 1:
        own = setting(project, key, 1, Number(1, sheets), tabs_own=True)
        sheet = own.number_input(f"Sheet (of {sheets})", width=200)
    on_it = items[(sheet - 1) * ON_A_SHEET : sheet * ON_A_SHEET]
    for start in range(0, len(on_it), COLUMNS):
        for item, column in zip(on_it[start:], st.columns(COLUMNS), strict=False):
            with column:
                show(item)


def badge(state: str) -> str:
    """The sign of a state, in Markdown."""
    icon, colour = BADGES[state]
    return f":{colour}-badge[{icon} {state}]"


def _show_frame(
    store: ProjectPhotographs, running: bool, look_closely: Callable[[int], None], frame: Frame
) -> None:
    alt = f"Both photographs of frame {frame.frame} about the targets found"
    st.image(thumbnail(store, frame.files, frame.centres), width="stretch", alt=alt)
    sigmas = [c.sigma_px for pair in frame.centres for c in pair if c and c.sigma_px is not None]
    seen = "corrected" if frame.corrected else "reviewed" if frame.reviewed else ""
    reviewed = f" · {seen}" if seen else ""
    sigma = f" · sigma ≤ {max(sigmas):.3f} px" if sigmas else ""
    st.markdown(f"{badge(frame.state)} **Frame {frame.frame}**{sigma}{reviewed}")
    if frame.reason:
        st.caption(escape_markdown(frame.reason))
    key = f"use_frame_{frame.frame}"

    @refusing()
    def choose_use() -> None:
        use = bool(st.session_state[key])
        change_review(store, lambda review: decide(review, frame.frame, use))

    st.session_state[key] = frame.use
    with st.container(horizontal=True, vertical_alignment="center"):
        may = not running and bool(frame.targets_in_both)
        st.checkbox("Use this frame", key=key, disabled=not may, on_change=choose_use)
        st.button(
            "Look closely",
            key=f"look_{frame.frame}",
            type="tertiary",
            icon=":material/zoom_in:",
            on_click=look_closely,
            args=(frame.frame,),
        )
