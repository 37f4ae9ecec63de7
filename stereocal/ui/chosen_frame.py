"""The chosen frame, the same on all pages: choose it, look at it, leave it out, put it back."""

from __future__ import annotations

from contextlib import suppress
from functools import partial

import numpy as np
import streamlit as st

from stereocal.detection.intensity import eight_bits
from stereocal.errors import StereocalError
from stereocal.figures.style import Photograph
from stereocal.figures.two_sets import telling_frame
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import TABLE_LABEL, ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.system.photograph import read_photograph
from stereocal.ui import screening as screened
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.messages import callback, readable
from stereocal.ui.review import look_closely

NAME = "frame"
"""Of the setting; the review of photographs has the same."""


def frame_field(project: Project, calibration: Calibration) -> Field:
    """The chosen frame; at first the one that shows best why there are two sets."""
    numbers: list[int] = calibration.dataset.correspondences.frames.tolist()
    fields = partial(setting, project, "chosen_frame", name=NAME, tabs_own=True)
    found = fields(None, one_of(numbers))
    if found.value() in numbers:
        return found
    return fields(telling_frame(calibration), one_of(numbers))


def choose_frame(project: Project, calibration: Calibration) -> int:
    """A menu of the frames, with buttons for the next and the previous one, and for corrections."""
    numbers: list[int] = calibration.dataset.correspondences.frames.tolist()
    field = frame_field(project, calibration)
    frame: int = field.value()
    at = numbers.index(frame)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        st.selectbox("Frame", numbers, width=140, **field.widget())
        for way, side, to in (("previous", "left", at - 1), ("next", "right", at + 1)):
            there = 0 <= to < len(numbers)
            st.button(
                f"{way.capitalize()} frame",
                icon=f":material/chevron_{side}:",
                key=f"{way}_frame",
                disabled=not there,
                on_click=callback(partial(field.set, numbers[to] if there else None)),
            )
        _actions(project, calibration, frame)
    return frame


def _actions(project: Project, calibration: Calibration, frame: int) -> None:
    """Buttons to leave the frame out, put it back, exchange its targets, or correct it."""
    screening, inputs = calibration.screening, project.inputs
    # As asked for last: without the frame there may have been no result.
    back = frame in screening.left_out and frame not in inputs.put_back
    again = "The result is made again at once."
    act = partial(st.button, args=(project, frame))
    if back or frame in inputs.left_out:
        icon = ":material/undo:"
        act("Put it back", "frame_put_back", again, icon=icon, on_click=screened.put_back)
    else:
        icon = ":material/close:"
        act("Leave it out", "frame_leave_out", again, icon=icon, on_click=screened.leave_out)
    if frame in screening.exchanged:
        act(
            "Exchange A and B",
            "frame_exchange",
            f"In the secondary image. {again}",
            icon=":material/swap_horiz:",
            on_click=screened.exchange_again,
        )
    if photographed(project) and st.button(
        "Correct it",
        key="frame_correct",
        icon=":material/edit:",
        on_click=partial(look_closely, ProjectPhotographs(project), frame),
        help="Its photographs on the Data page.",
    ):
        st.switch_page("pages/data.py")


def state_of(calibration: Calibration, frame: int) -> str:
    """What a frame is used for, as a sentence."""
    screening = calibration.screening
    if frame in screening.by_user:
        return f"Frame {frame} was left out by you."
    if frame in screening.copies:
        first = screening.copies[frame]
        return f"Frame {frame} has exactly the points of frame {first}, and was left out."
    if frame in screening.without_neighbours:
        return f"Frame {frame} has no neighbours in time to shift its points by; it was left out."
    if frame in screening.left_out:
        also = " A and B look exchanged in one camera." if frame in screening.exchanged else ""
        return f"Frame {frame} contradicts the others and was left out.{also}"
    if frame in calibration.held_out_frames:
        return f"Frame {frame} was held out."
    return f"Frame {frame} is used."


def photographs_of(project: Project, frame: int) -> tuple[Photograph | None, Photograph | None]:
    """Both photographs of a frame; None for one that is not there."""
    if photographed(project):
        store = ProjectPhotographs(project)
        files = store.photographs
        for found in readable(lambda: store.frames) or ():
            if found.frame == frame:
                first, second = (
                    _decoded(files[name].name, files[name], name) if name in files else None
                    for name in found.files
                )
                return first, second
    return None, None


def frames_photographed(project: Project) -> set[int]:
    """The frames of the project's photographs."""
    if not photographed(project):
        return set()
    store = ProjectPhotographs(project)
    return {frame.frame for frame in readable(lambda: store.frames) or ()}


def photographed(project: Project) -> bool:
    """Whether the points come from photographs of the project."""
    return project.inputs.labels.get("correspondences") == TABLE_LABEL


@st.cache_resource(show_spinner=False, max_entries=8)
def _decoded(digest: str, _file: StoredFile, _name: str) -> Photograph | None:
    assert digest
    with suppress(StereocalError):
        return np.asarray(eight_bits(read_photograph(_file, _name)), np.uint8)
    return None
