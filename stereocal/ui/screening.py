"""Frames that contradict the others: cached screening, and buttons to correct or keep them."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.frames.review import swap
from stereocal.projects.photographs import TABLE_LABEL, ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review
from stereocal.refined.diagnosis import OUT_OF_STEP
from stereocal.refined.results import Calibration
from stereocal.refined.screening import Screening, screened
from stereocal.rig.dataset import Dataset
from stereocal.ui import jobs
from stereocal.ui.messages import callback

MOST_BUTTONS = 6
"""Maximum number of frames with an Exchange button."""
_AGAIN = "calibrate_again"
MOST_AT_ONCE = 1500
"""Frames that calibrate in about a second, and so while a page is drawn."""


def is_long(dataset: Dataset) -> bool:
    """Whether a recording takes seconds to calibrate, so that no draw of a page may wait for it."""
    return len(dataset.correspondences.frames) > MOST_AT_ONCE


def screenings_of(
    datasets: Sequence[Dataset],
    settings: CalibrationSettings,
    calibration: Calibration | None = None,
) -> list[Screening]:
    """The screenings of the project's data set, the first, and of further ones, cached.

    Frames put back and left out are those of the first.

    Args:
        calibration: the stored result: its screening is not made again.
    """
    others = replace(settings, frames_put_back=(), frames_left_out=())
    own = [settings, *[others] * (len(datasets) - 1)]
    known = None if calibration is None else _key(calibration.dataset, calibration.settings)
    return [
        calibration.screening
        if calibration is not None and known == _key(dataset, chosen)
        else _screened(_key(dataset, chosen), dataset, chosen)
        for dataset, chosen in zip(datasets, own, strict=True)
    ]


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
            st.button(
                f"Exchange A and B in frame {frame}",
                key=f"exchange_{frame}",
                icon=":material/swap_horiz:",
                on_click=partial(exchange_again, project, frame),
                help="In the secondary image. The result is made again at once.",
            )
        first = screening.left_out[0]
        st.button(
            f"Look at frame {first}",
            key="look_left_out",
            icon=":material/search:",
            on_click=partial(look, first),
            help="There it can be put back.",
        )


def offer_to_bring_into_step(project: Project, calibration: Calibration) -> None:
    """A button to calibrate with the time offset, if the cameras seem to be out of step."""
    if any(warning.startswith(OUT_OF_STEP) for warning in calibration.warnings):
        st.button(
            "Calibrate with the time offset",
            key="bring_into_step",
            icon=":material/schedule:",
            on_click=partial(bring_into_step, project),
            help="It becomes an unknown, and the secondary points are shifted by it.",
        )


@callback
def bring_into_step(project: Project) -> None:
    """Find the time offset, and calibrate again (a callback)."""
    project.keep_settings({"time_offset": True})
    calibrate_next()


def calibrate_next() -> None:
    """Let the Calibrate page calibrate when it is drawn next."""
    st.session_state[_AGAIN] = True


def show_exchanged(project: Project) -> None:
    """The frames whose targets the user has exchanged, with buttons to undo that."""
    frames = project.inputs.exchanged
    if not frames:
        return
    with st.container(horizontal=True):
        for frame in frames[:MOST_BUTTONS]:
            st.button(
                f"Frame {frame}: take the exchange back",
                key=f"unexchange_{frame}",
                icon=":material/undo:",
                on_click=partial(exchange_again, project, frame),
                help="A and B of this frame were exchanged in the secondary image.",
            )


def calibrate_again() -> bool:
    """Whether `calibrate_next` was called since the last run of the page."""
    return bool(st.session_state.pop(_AGAIN, False))


def rerun_if_changed() -> None:
    """In a fragment: run the whole page if it is to calibrate again."""
    if st.session_state.get(_AGAIN):
        st.rerun()


@callback
def leave_out(project: Project, frame: int) -> None:
    """Leave a frame out, and calibrate again (a callback)."""
    project.leave_out(frame)
    calibrate_next()


@callback
def put_back(project: Project, frame: int) -> None:
    """Use a frame that was left out, and calibrate again (a callback)."""
    project.take_in(frame)
    calibrate_next()


@callback
def exchange_again(project: Project, frame: int) -> None:
    """Exchange A and B in the secondary image, and calibrate again (a callback)."""
    if project.inputs.labels.get("correspondences") == TABLE_LABEL:
        change_review(ProjectPhotographs(project), lambda review: swap(review, frame, 1))
    else:
        project.exchange_targets(frame)
    calibrate_next()


def _key(dataset: Dataset, settings: CalibrationSettings) -> str:
    """Includes name and notes, because messages show them."""
    names = ("all_frames", "frames_put_back", "frames_left_out", "time_offset", "time_drift")
    return json.dumps([*dataset.identity, *(getattr(settings, name) for name in names)])


@st.cache_resource(show_spinner="Looking for frames that contradict the others.", max_entries=64)
def _screened(key: str, _dataset: Dataset, _settings: CalibrationSettings) -> Screening:
    assert key
    return jobs.compute(screened, _dataset, _settings)
