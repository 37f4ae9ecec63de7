"""The cards of the projects on the Start page: what each holds, and what can be done with it."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.projects.data_folder import default_home
from stereocal.projects.home import Card, Listed, card_of, duplicate, remove, title_of
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings
from stereocal.ui.messages import callback
from stereocal.ui.project import is_open, open_project
from stereocal.ui.texts import escape_markdown

REMOVED = "removed_project"
OPENED = "opened_project"
"""The project whose card was pressed: the next run opens it."""
WIDTH = 250


def show_cards(projects: Sequence[Listed]) -> None:
    """The cards side by side, as many in a row as fit."""
    with st.container(horizontal=True):
        for one in projects:
            with st.container(border=True, width=WIDTH):
                (_show_unreadable if one.damaged or one.unreadable else _show)(one)


def date_of(seconds: float) -> str:
    """A time in seconds since 1970, as shown."""
    return datetime.fromtimestamp(seconds).astimezone().strftime("%Y-%m-%d %H:%M")


def _show(one: Listed) -> None:
    try:
        card = _card(one.id, one.changed)
    except StereocalError as error:
        card = Card("cannot be read", str(error))
    state = ", interrupted" * one.interrupted
    st.markdown(f"**{escape_markdown(one.title)}**")
    st.caption(
        f"{date_of(one.changed)}, {escape_markdown(card.data)}  \n"
        f"{escape_markdown(card.result)}{state}"
    )
    key = f"name_{one.id}"
    with st.container(horizontal=True):
        st.button("Open", key=f"open_{one.id}", on_click=_open, args=(one.id,))
        with st.popover("More"):
            st.text_input(
                "Name",
                one.title,
                key=key,
                placeholder="Give it a name",
                on_change=_rename,
                args=(one.id, key),
            )
            for label, act in (("Duplicate", _duplicate), ("Remove", _remove)):
                st.button(label, key=f"{label.lower()}_{one.id}", on_click=act, args=(one.id,))


def _show_unreadable(one: Listed) -> None:
    why = one.unreadable or (
        "the file of this project is damaged. It is kept as it is. Open the project's last backup "
        "(its zip) below."
    )
    st.warning(f"{date_of(one.changed)}: {escape_markdown(why)}")
    st.button("Remove", key=f"remove_{one.id}", on_click=_remove, args=(one.id,))


@st.cache_data(show_spinner=False, max_entries=500)
def _card(project_id: str, changed: float) -> Card:
    assert changed >= 0
    return card_of(Project.open(default_home(), project_id))


@callback
def _rename(project_id: str, key: str) -> None:
    Project.open(default_home(), project_id).rename(st.session_state[key].strip())


def _open(project_id: str) -> None:
    # Not opened here: that empties the session, with a name that was typed before the click.
    st.session_state[OPENED] = project_id


@callback
def _duplicate(project_id: str) -> None:
    copy = duplicate(default_home(), project_id)
    if ServerSettings.from_environment().shared:  # there is no list to find it in
        open_project(copy.id)


@callback
def _remove(project_id: str) -> None:
    name = ""
    with suppress(StereocalError):  # a damaged one can be removed too
        name = title_of(Project.open(default_home(), project_id))
    remove(default_home(), project_id)
    if not is_open(project_id):  # for the open one, `offer_removed` does
        st.session_state[REMOVED] = (project_id, name)
