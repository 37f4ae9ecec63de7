"""The open project: its id stands in the URL, everything else on disk."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.formats.evaluation_files import Evaluation
from stereocal.projects.data_folder import default_home
from stereocal.projects.home import bring_back, removed_at
from stereocal.projects.inputs import Inputs, Slot
from stereocal.projects.photographs import TABLE_LABEL
from stereocal.projects.project import Project
from stereocal.refined.results import Calibration
from stereocal.ui.messages import attempt, callback, readable, tell
from stereocal.ui.texts import escape_markdown

SAMPLE = Path(__file__).parents[2] / "sample_data" / "field"
SLOT_TITLES: Mapping[str, Slot] = {
    "table of points": "correspondences",
    "primary camera": "primary",
    "secondary camera": "secondary",
}
_RESET = "forms_anew"
_BEGUN = "projects_begun"
_ID, _INPUTS = "project_id", "inputs_seen"


def keep_address() -> None:
    """Put the project's id back into the URL, which a change of page has emptied."""
    if "project" in st.query_params:
        st.session_state[_ID] = st.query_params["project"]
    elif _ID in st.session_state:
        st.query_params["project"] = st.session_state[_ID]


def current_project() -> Project | None:
    """The project that the URL names; None before there is one.

    An address that names none is said on the page, which then stops.
    """
    project_id = st.session_state.get(_ID)
    if project_id is None:
        return None
    try:
        project = Project.open(default_home(), project_id)
        report_changes(project)
        return project
    except StereocalError as error:
        if not offer_removed():
            st.error(escape_markdown(str(error)))
            st.button("Start a new project", on_click=forget_project, type="primary")
        st.stop()


def is_open(project_id: str) -> bool:
    """Whether this is the project of the address."""
    return st.session_state.get(_ID) == project_id


def offer_removed() -> bool:
    """Say that the project of the address was removed, and offer it; False if it was not."""
    project_id = st.session_state.get(_ID)
    when = None if project_id is None else removed_at(default_home(), project_id)
    if project_id is None or when is None:
        return False
    date = datetime.fromtimestamp(when).astimezone().strftime("%Y-%m-%d")
    st.warning(f"This project was removed on {date}.")
    with st.container(horizontal=True):
        st.button(
            "Bring it back", key="bring_it_back", type="primary",
            on_click=bring_project_back, args=(project_id,),
        )  # fmt: skip
        st.button("Start a new project", on_click=forget_project)
    return True


@callback
def bring_project_back(project_id: str) -> None:
    """Undo the removal of a project (a callback)."""
    bring_back(default_home(), project_id)


def project_to_write() -> Project:
    """The current project, made now if there is none yet."""
    return current_project() or new_project()


def new_project() -> Project:
    """Begin a project and make it the current one."""
    project = Project.create(default_home())
    open_project(project.id)
    return project


@callback
def begin_project() -> None:
    """Begin a project (a callback)."""
    new_project()


def open_project(project_id: str) -> None:
    """Make a project the current one; what the screen knew of another is forgotten."""
    if _ID in st.session_state:
        forget_project()
    st.session_state[_ID] = project_id
    st.query_params["project"] = project_id


def begun() -> list[Future[Project]]:
    """Projects that are being made for this tab, to be opened on whichever page comes next.

    The list itself is handed to the callback that begins one. A click elsewhere ends a run at its
    next access to the session, and a new run begins beside it: only what is shared stays.
    """
    making: list[Future[Project]] = st.session_state.setdefault(_BEGUN, [])
    return making


def open_begun() -> bool:
    """Open the project that was begun last, once it is whole; False if there is none."""
    making = begun()
    if not making:
        return False
    with st.spinner("Opening the sample."):
        project = attempt(making[-1].result)
    if project is None:
        making.clear()
        return False
    for key in list(st.session_state):
        if key != _BEGUN:
            del st.session_state[key]
    st.session_state[_ID] = project.id
    st.query_params["project"] = project.id
    making.clear()
    return True


def forget_project() -> None:
    """Leave the current project; it stays on disk under its address."""
    st.session_state.clear()
    st.query_params.clear()


def last_calibration(project: Project) -> Calibration | None:
    """The last result; None, and a sentence, where it is damaged."""
    return readable(lambda: project.calibration)


def last_evaluation(project: Project) -> Evaluation | None:
    """The last validation; None, and a sentence, where it is damaged."""
    return readable(lambda: project.evaluation)


def reset_forms() -> bool:
    """Forget what this tab holds of its forms; False if that was just done, and did not help."""
    if st.session_state.get(_RESET):
        return False
    project_id = st.session_state.get(_ID)
    st.session_state.clear()
    if project_id is not None:
        st.session_state[_ID] = project_id
    st.session_state[_RESET] = True
    tell("A form held values that cannot be used: it begins with the usual ones.", "info")
    return True


def forms_are_sound() -> None:
    """A page was drawn with them."""
    st.session_state.pop(_RESET, None)


def report_changes(project: Project) -> None:
    """Tell of inputs that another tab has changed since this one was drawn.

    A table that was made of photographs is not told of: this tab's own search may have made it.
    """
    now = _shown_inputs(project)
    before = st.session_state.get(_INPUTS)
    st.session_state[_INPUTS] = now
    if before is None or before["id"] != now["id"]:
        return
    changed = [what for what in now if now[what] != before[what] and now[what] != TABLE_LABEL]
    if changed:
        said = "; ".join(f"{what}: {now[what]}" for what in changed)
        tell(f"Changed in another tab: {said}.", "info")


@contextmanager
def own_change(project: Project) -> Iterator[None]:
    """What changes inside is this tab's own doing, and needs not be told."""
    report_changes(project)
    try:
        yield
    finally:
        st.session_state[_INPUTS] = _shown_inputs(project)


def _shown_inputs(project: Project) -> dict[str, str]:
    inputs = project.inputs
    return {
        "id": project.id,
        "baseline": _length(inputs.baseline_m),
        "distance between the targets": _length(inputs.target_distance_m),
        **{title: _file(inputs, slot) for title, slot in SLOT_TITLES.items()},
    }


def _length(metres: float | None) -> str:
    return "none" if metres is None else f"{metres:.12g} m"


def _file(inputs: Inputs, slot: Slot) -> str:
    if slot not in inputs.files:
        return "none"
    label = inputs.labels[slot]
    return label if label == TABLE_LABEL else f"{label} ({inputs.files[slot][:8]})"
