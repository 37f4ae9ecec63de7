"""The open project: its id is in the URL, everything else on disk."""

from concurrent.futures import Future
from contextlib import suppress
from datetime import datetime
from functools import partial

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import StereocalError
from stereocal.projects.home import bring_back, changed_at, removed_at, title_of
from stereocal.projects.project import Project
from stereocal.projects.server_settings import default_home
from stereocal.ui.fields import Field
from stereocal.ui.messages import attempt, button, end_here
from stereocal.ui.texts import escape_markdown

_BEGUN = "projects_begun"
_ID = "project_id"


def keep_address() -> None:
    """Restore the project's id in the URL, which a change of page removes."""
    if "project" in st.query_params:
        st.session_state[_ID] = st.query_params["project"]
    elif _ID in st.session_state:
        _set_address(st.session_state[_ID])


def _set_address(project_id: str) -> None:
    st.session_state[_ID] = st.query_params["project"] = project_id


def _open() -> Project:
    """The project of the URL."""
    return Project.open(default_home(), st.session_state.get(_ID, ""))


def current_project() -> Project | None:
    """The project of the URL; None without one. An invalid URL is reported, and the page stops."""
    if st.session_state.get(_ID) is None:
        return None
    try:
        return _open()
    except StereocalError as error:
        if not offer_removed():
            st.error(escape_markdown(str(error)))
            st.button("Start a new project", on_click=forget_project, type="primary")
        end_here()


def open_or_none() -> Project | None:
    """The project of the URL; None without one that can be opened, which pages report."""
    with suppress(StereocalError, OSError):
        return _open()
    return None


def show_project(project: Project | None) -> DeltaGenerator:
    """The project's name, to change; returns the place for `show_saved`."""
    with suppress(StereocalError):  # reported by the page
        if project is not None:
            key = "project_name"
            name = Field(key, key, lambda: project.inputs.name, project.rename)
            st.text_input("Project", placeholder=title_of(project), **name.widget())
    return st.empty()


def show_saved(project: Project | None, place: DeltaGenerator) -> None:
    """When the project was last written to disk."""
    changed = changed_at(project.database.path) if project else 0.0
    if changed:
        place.caption(f"Saved {date_of(changed)}")


def date_of(seconds: float) -> str:
    """A time in seconds since 1970, as shown."""
    return datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M")


def is_open(project_id: str) -> bool:
    """Whether this is the project of the URL."""
    return st.session_state.get(_ID) == project_id


def offer_removed() -> bool:
    """Report that the project of the URL was removed, and offer it back; False if it was not."""
    project_id = st.session_state.get(_ID)
    when = None if project_id is None else removed_at(default_home(), project_id)
    if project_id is None or when is None:
        return False
    st.warning(f"This project was removed on {date_of(when)[:10]}.")
    with st.container(horizontal=True):
        back = partial(bring_back, default_home(), project_id)
        button("Bring it back", "bring_it_back", back, first=True)
        st.button("Start a new project", on_click=forget_project)
    return True


def project_to_write() -> Project:
    """The current project, or a new one."""
    project = current_project()
    if project is None:
        project = Project.create(default_home())
        open_project(project.id)
    return project


def open_project(project_id: str) -> None:
    """Open a project; the session state of another one is cleared."""
    if _ID in st.session_state:
        forget_project()
    _set_address(project_id)


def projects_in_creation() -> list[Future[Project]]:
    """Projects being created for this tab, which the next run of any page opens.

    Callbacks get the list itself: a click may end their run at its next access to the session.
    """
    making: list[Future[Project]] = st.session_state.setdefault(_BEGUN, [])
    return making


def open_created() -> bool:
    """Wait for the project created last, and open it; False if there is none."""
    making = projects_in_creation()
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
    _set_address(project.id)
    making.clear()
    return True


def forget_project() -> None:
    """Close the current project; it stays on disk."""
    st.session_state.clear()
    st.query_params.clear()
