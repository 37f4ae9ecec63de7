"""The open project: its id stands in the URL, everything else on disk."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import streamlit as st

from stereocal.calibrate import calibrate
from stereocal.errors import StereocalError
from stereocal.evaluation import EvaluationSettings, evaluate_runs
from stereocal.formats.dataset_files import read_dataset
from stereocal.frames.search import compile_detection
from stereocal.matching import match_points
from stereocal.project import Project
from stereocal.store.folders import default_home
from stereocal.store.server import ServerSettings
from stereocal.store.sweep import sweep

SAMPLE = Path(__file__).parents[2] / "sample_data" / "field"
_ID = "project_id"


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
        return Project.open(default_home(), project_id)
    except StereocalError as error:
        st.error(str(error))
        st.button("Start a new project", on_click=forget_project, type="primary")
        st.stop()


def project_to_write() -> Project:
    """The current project, made now if there is none yet."""
    return current_project() or new_project()


def new_project() -> Project:
    """Begin a project and make it the current one."""
    project = Project.create(default_home())
    open_project(project.id)
    return project


def begin_project() -> None:
    """Begin a project (a callback)."""
    new_project()


def open_project(project_id: str) -> None:
    """Make a project the current one; what the screen knew of another is forgotten."""
    if _ID in st.session_state:
        forget_project()
    st.session_state[_ID] = project_id
    st.query_params["project"] = project_id


def forget_project() -> None:
    """Leave the current project; it stays on disk under its address."""
    st.session_state.clear()
    st.query_params.clear()


def remembered(project: Project, defaults: Mapping[str, Any]) -> None:
    """Give widgets their kept values, before they are drawn.

    Session state forgets a widget that a page does not draw; the project does not.
    """
    kept = project.settings
    for key, default in defaults.items():
        if key not in st.session_state:
            st.session_state[key] = kept.get(key, default)


def keeper(project: Project, key: str) -> Callable[[], None]:
    """The callback that keeps the value of the widget `key` in the project."""

    def keep() -> None:
        project.keep_settings({key: st.session_state[key]})

    return keep


@st.cache_resource(show_spinner=False)
def warm_up() -> threading.Thread:
    """What is done in the background when the server starts."""
    thread = threading.Thread(target=_begin, daemon=True, name="warm-up")
    thread.start()
    return thread


def _begin() -> None:
    """Delete what is too old; compile (25 s the very first time)."""
    settings = ServerSettings.from_environment()
    sweep(default_home(), settings.undo_days, settings.keep_days)
    compile_all()


def compile_all() -> None:
    """Use all compiled code once, so that nobody waits for it later."""
    dataset = read_dataset(SAMPLE)
    calibration = calibrate(dataset, trace=True)
    rows = dataset.correspondences
    match_points(calibration.parameters("2d"), rows.primary, rows.secondary, 1.0)
    evaluate_runs(dataset, EvaluationSettings(), 0, [0])
    compile_detection()
