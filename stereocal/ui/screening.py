"""Frames that contradict the others: cached screening, and buttons to correct or keep them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace

import streamlit as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.frames.review import swap
from stereocal.projects.photographs import TABLE_LABEL, ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.review import change_review
from stereocal.refined.results import Calibration
from stereocal.refined.screening import Screening, screened
from stereocal.rig.dataset import Dataset
from stereocal.ui import jobs
from stereocal.ui.fields import Field
from stereocal.ui.intake import escape_markdown
from stereocal.ui.messages import callback
from stereocal.verdict.in_words import left_out_line

MOST_BUTTONS = 6
"""Maximum number of frames with an Exchange button."""
_AGAIN = "calibrate_again"


def screenings_of(datasets: Sequence[Dataset], settings: CalibrationSettings) -> list[Screening]:
    """The screenings of the project's data set, the first, and of further ones, cached.

    Frames put back and left out are those of the first.
    """
    others = replace(settings, frames_put_back=(), frames_left_out=())
    own = [settings, *[others] * (len(datasets) - 1)]
    return [
        _screened(_key(dataset, chosen), dataset, chosen)
        for dataset, chosen in zip(datasets, own, strict=True)
    ]


def put_back_field(project: Project) -> Field:
    """The frames that the user has put back."""
    key = "frames_put_back"
    return Field(key, key, lambda: project.inputs.put_back, project.put_back)


def show_left_out(project: Project, calibration: Calibration) -> None:
    """The frames left out, with buttons to exchange targets or put frames back."""
    screening = calibration.screening
    field = put_back_field(project)
    frames = sorted({*screening.left_out, *field.value()})
    if not frames:
        return
    if screening.left_out:
        st.warning(escape_markdown(left_out_line(screening)))
    with st.container(horizontal=True):
        for frame in screening.exchanged[:MOST_BUTTONS]:
            st.button(
                f"Exchange A and B in frame {frame}", key=f"exchange_{frame}",
                icon=":material/swap_horiz:", on_click=_exchange, args=(project, frame),
                help="In the secondary image. The result is made again at once.",
            )  # fmt: skip
    st.pills(
        "Put frames back", frames, selection_mode="multi",
        help="A frame that is marked is used, though it contradicts the others.",
        **(field.widget() | {"on_change": _put_back, "args": (field,)}),
    )  # fmt: skip


def show_exchanged(project: Project) -> None:
    """The frames whose targets the user has exchanged, with buttons to undo that."""
    frames = project.inputs.exchanged
    if not frames:
        return
    with st.container(horizontal=True):
        for frame in frames[:MOST_BUTTONS]:
            st.button(
                f"Frame {frame}: take the exchange back", key=f"unexchange_{frame}",
                icon=":material/undo:", on_click=_exchange, args=(project, frame),
                help="A and B of this frame were exchanged in the secondary image.",
            )  # fmt: skip


def calibrate_again() -> bool:
    """Whether a frame was put back or exchanged since the last run of the page."""
    return bool(st.session_state.pop(_AGAIN, False))


@callback
def _put_back(field: Field) -> None:
    field.set(st.session_state[field.key])
    st.session_state[_AGAIN] = True


@callback
def _exchange(project: Project, frame: int) -> None:
    exchange(project, frame)
    st.session_state[_AGAIN] = True


def exchange(project: Project, frame: int) -> None:
    """Exchange A and B in the secondary image: in the review of photographs, else in the table.

    Raises:
        StereocalError: it cannot be kept.
    """
    if project.inputs.labels.get("correspondences") == TABLE_LABEL:
        change_review(ProjectPhotographs(project), lambda review: swap(review, frame, 1))
    else:
        project.exchange_targets(frame)


def _key(dataset: Dataset, settings: CalibrationSettings) -> str:
    """Includes name and notes, because messages show them."""
    about = [dataset.sha256, dataset.name, dataset.notes]
    return json.dumps(
        [*about, settings.all_frames, settings.frames_put_back, settings.frames_left_out]
    )


@st.cache_resource(show_spinner="Looking for frames that contradict the others.", max_entries=64)
def _screened(key: str, _dataset: Dataset, _settings: CalibrationSettings) -> Screening:
    assert key
    return jobs.compute(screened, _dataset, _settings)
