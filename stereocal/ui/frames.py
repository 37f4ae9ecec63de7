"""Frames: the chosen one of all pages, and what can be changed about one."""

from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import TypeVar

import numpy as np
import streamlit as st

from stereocal.detection.intensity import eight_bits
from stereocal.errors import StereocalError
from stereocal.figures.style import Photograph
from stereocal.figures.two_sets import telling_frame
from stereocal.fit.results import Calibration
from stereocal.fit.screening.screen import Screening
from stereocal.frames.frame import Frame
from stereocal.frames.review import swap
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import TABLE_LABEL, ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review
from stereocal.rig.camera import camera_in_words
from stereocal.system.latest import once
from stereocal.system.photograph import read_photograph
from stereocal.ui.fields import Field, one_of, setting
from stereocal.ui.messages import button, readable
from stereocal.ui.press import press
from stereocal.ui.review import look_closely

T = TypeVar("T")
NAME = "frame"
"""The setting of the chosen frame, which the review of photographs shares."""
AGAIN, CORRECT = "The result is made again at once.", "Its photographs on the Data page."
AGAIN, CORRECT = "The result is made again at once.", "Its photographs on the Data page."
MOST_BUTTONS = 6
"""Maximum number of frames with an Exchange button."""


def show_left_out(project: Project, calibration: Calibration, look: Callable[[int], None]) -> None:
    """Buttons to exchange targets, and to look at a frame that was left out.

    Args:
        look: opens a frame.
    """
    screening = calibration.screening
    if not screening.left_out:
        return
    with st.container(horizontal=True):
        for frame in screening.exchanged[:MOST_BUTTONS]:
            label = f"Exchange A and B in frame {frame}"
            _exchange_button(project, screening, frame, label, f"exchange_{frame}")
        first, hint = screening.left_out[0], "There it can be put back."
        label = f"Look at frame {first}"
        button(label, "look_left_out", look, first, icon="search", help=hint)


def _exchange_button(
    project: Project, screening: Screening, frame: int, label: str, key: str
) -> None:
    """A button to exchange A and B in the image of the second camera."""
    camera = screening.full_dataset.names[1]
    hint = f"In the image of {camera_in_words(camera)}. {AGAIN}"
    button(label, key, _exchange, project, frame, camera, icon="swap_horiz", help=hint)


def show_exchanged(project: Project) -> None:
    """The frames whose targets the user has exchanged, with buttons to undo that."""
    with st.container(horizontal=True):
        for camera, frames in project.inputs.exchanged.items():
            words = camera_in_words(camera)
            hint = f"A and B of this frame were exchanged in the image of {words}."
            for frame in frames[:MOST_BUTTONS]:
                label = f"Frame {frame}: take the exchange back"
                key = f"unexchange_{camera}_{frame}"
                button(label, key, _exchange, project, frame, camera, icon="undo", help=hint)


def offer_to_bring_into_step(project: Project, calibration: Calibration) -> None:
    """A button to calibrate with the time offset, if the cameras seem to be out of step."""
    if calibration.out_of_step:
        hint = "It becomes an unknown, and the secondary points are shifted by it."
        act = partial(_change, project, project.keep_settings, {"time_offset": True})
        label, key = "Calibrate with the time offset", "bring_into_step"
        button(label, key, act, icon="schedule", help=hint)


def _change(project: Project, act: Callable[[T], object], value: T) -> None:
    """Change the project, and calibrate again (a callback)."""
    act(value)
    press(project.whole)


def _exchange(project: Project, frame: int, camera: str) -> None:
    """Exchange A and B in the image of a camera, and calibrate again (a callback)."""
    if photographed(project):
        act = partial(change_review, ProjectPhotographs(project))
        _change(project, act, lambda review: swap(review, frame, 1))
    else:
        _change(project, partial(project.exchange_targets, frame), camera)


def frame_field(project: Project, calibration: Calibration) -> Field:
    """The chosen frame; at first the one that shows best why there are two sets."""
    numbers = calibration.dataset.correspondences.frames.tolist()
    fields = partial(setting, project, "chosen_frame", name=NAME, tabs_own=True)
    field = fields(None, one_of(numbers))
    if field.value() in numbers:
        return field
    return fields(telling_frame(calibration), one_of(numbers))


def choose_frame(project: Project, calibration: Calibration) -> int:
    """A menu of the frames, with buttons for the next and the previous one, and for corrections."""
    numbers = calibration.dataset.correspondences.frames.tolist()
    field = frame_field(project, calibration)
    frame: int = field.value()
    index = numbers.index(frame)
    with st.container(horizontal=True, vertical_alignment="bottom"):
        field.menu("Frame", width=140)
        for way, side, to in (("previous", "left", index - 1), ("next", "right", index + 1)):
            label, icon = f"{way.capitalize()} frame", f"chevron_{side}"
            exists = 0 <= to < len(numbers)
            number = numbers[to] if exists else None
            button(label, f"{way}_frame", field.set, number, icon=icon, disabled=not exists)
        _actions(project, calibration.screening, frame)
    return frame


def _actions(project: Project, screening: Screening, frame: int) -> None:
    """Buttons to leave the frame out, put it back, exchange its targets, or correct it."""
    inputs = project.inputs
    # As asked for last: without the frame there may have been no result.
    back = frame in screening.left_out and frame not in inputs.put_back
    label, key, act, icon = "Leave it out", "frame_leave_out", project.leave_out, "close"
    if back or frame in inputs.left_out:
        label, key, act, icon = "Put it back", "frame_put_back", project.take_in, "undo"
    button(label, key, _change, project, act, frame, icon=icon, help=AGAIN)
    if frame in screening.exchanged:
        _exchange_button(project, screening, frame, "Exchange A and B", "frame_exchange")
    if photographed(project):
        look, hint = partial(look_closely, ProjectPhotographs(project)), CORRECT
        if button("Correct it", "frame_correct", look, frame, icon="edit", help=hint):
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
    use = "was held out" if frame in calibration.held_out_frames else "is used"
    return f"Frame {frame} {use}."


def photographed(project: Project) -> bool:
    """Whether the points come from photographs of the project."""
    return project.inputs.labels.get("correspondences") == TABLE_LABEL


def frames_photographed(project: Project) -> dict[int, Frame]:
    """The frames of the project's photographs."""
    store = ProjectPhotographs(project)
    frames = readable(lambda: store.frames) if photographed(project) else None
    return {frame.frame: frame for frame in frames or ()}


def photographs_of(project: Project, frame: int) -> tuple[Photograph | None, Photograph | None]:
    """Both photographs of a frame; None for one that is not there."""
    shown_frame = frames_photographed(project).get(frame)
    files = ProjectPhotographs(project).photographs if shown_frame else {}
    first, second = (
        once("photograph", files[name].name, partial(_decoded, files[name], name))
        if name in files
        else None
        for name in (shown_frame.files if shown_frame else ("", ""))
    )
    return first, second


def _decoded(file: StoredFile, name: str) -> Photograph | None:
    with suppress(StereocalError):
        return np.asarray(eight_bits(read_photograph(file, name)), np.uint8)
    return None
