"""The projects on the Start page: recent and removed ones, export and import."""

import math
import os
import re
import tempfile
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TypeVar

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.projects import home
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.database import journal_of
from stereocal.projects.home import Card, card_of, title_of
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings, default_home
from stereocal.system.latest import once
from stereocal.system.limits import MB
from stereocal.ui import jobs
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, setting
from stereocal.ui.intake import check_uploads, is_new, taking
from stereocal.ui.messages import ErrorsShown, button, callback, show_with_button, tell
from stereocal.ui.press import final_answer
from stereocal.ui.project import current_project, date_of, is_open, offer_removed, open_project
from stereocal.ui.texts import escape_markdown

ON_A_PAGE = 9
T = TypeVar("T")
_OPENED, _REMOVED = "opened_project", "removed_project"
"""The project whose card was pressed, which the next run opens; and the one removed last."""
_UNPACKED = "unpacked_projects"
"""Ids of imported projects by upload: a click may interrupt the opening of one."""


def show_projects() -> Project | None:
    """The projects to open, rename, duplicate or remove, and removed ones to bring back.

    A shared server shows only the open project, and a removed one only under its address.

    Returns:
        The open project.
    """
    if opened := st.session_state.pop(_OPENED, None):
        open_project(opened)
        st.switch_page("pages/data.py")
    folder = default_home() / "projects"
    if folder.is_dir() and not os.access(folder, os.W_OK):
        st.warning(
            "The folder of the projects is read-only, so that nothing can be stored: look at its "
            "permissions."
        )
    elif folder.is_dir() and journal_of(folder) == "delete":
        st.info(
            "The disk of the projects cannot be shared safely between servers, as many network "
            "disks cannot: use one server only for them."
        )
    project = None if offer_removed() else current_project()
    if not ServerSettings.from_environment().shared:
        removed = home.removed_projects(default_home())
        last = st.session_state.get(_REMOVED)
        for entry in (entry for entry in removed if entry.id == last):
            words, undo = f"{entry.title or 'The project'} was removed.", home.bring_back
            show_with_button("info", words, "Undo", "undo_remove", undo, default_home(), entry.id)
        _show_all()
        if removed:
            _show_removed(removed)
    elif project is not None:
        st.markdown("#### The open project")
        _show_cards([home.entry_of(project)])
    return project


def _show_all() -> None:
    """The projects, the one changed last first, page by page, and a search where they are many."""
    ids = home.find_projects(default_home())
    if not ids:
        return
    st.markdown("#### Your projects")
    search = ""
    if len(ids) > ON_A_PAGE:
        typed = setting(None, "projects_search", "", str)
        label = f"Search all {len(ids)} projects by name"
        search = st.text_input(label, width=400, **typed.widget())
        ids = home.find_projects(default_home(), search) if search.strip() else ids
    if not ids:
        st.info(f"No project has “{escape_markdown(search.strip())}” in its name.")
    of_page = _of_page(ids, "projects_page", search)
    _show_cards(home.recent_projects(default_home(), of_page))


def _of_page(ids: Sequence[T], key: str, search: str = "") -> Sequence[T]:
    """Those of the chosen page, and the choice of another, if there are several.

    Args:
        search: each begins at its first page.
    """
    pages = -(-len(ids) // ON_A_PAGE)
    if pages < 2:
        return ids
    page = setting(None, key, 1, Number(1, pages), name=f"{key} {search}")
    chosen = st.pagination(pages, **page.widget("default"))
    return ids[(chosen - 1) * ON_A_PAGE : chosen * ON_A_PAGE]


def _show_cards(projects: Sequence[home.Listed]) -> None:
    """What each project holds and what can be done with it, as many in a row as fit."""
    with st.container(horizontal=True):
        for entry in projects:
            with st.container(border=True, width=250):
                (_show_unreadable if entry.damaged or entry.unreadable else _show)(entry)


def _show(entry: home.Listed) -> None:
    try:
        card = once(
            "card",
            f"{entry.id} {entry.changed}",
            lambda: card_of(Project.open(default_home(), entry.id)),
        )
    except StereocalError as error:
        card = Card("cannot be read", str(error))
    state = ", interrupted" * entry.interrupted
    st.markdown(f"**{escape_markdown(entry.title)}**")
    st.caption(
        f"{date_of(entry.changed)}, {escape_markdown(card.data)}  \n"
        f"{escape_markdown(card.result)}{state}"
    )
    key = f"name_{entry.id}"
    with st.container(horizontal=True):
        # Opened by the next run: that empties the session, with a name typed before the click.
        st.button("Open", f"open_{entry.id}", on_click=_open, args=(entry.id,))
        with st.popover("More"):
            rename = partial(_rename, entry.id, key)
            placeholder = "Give it a name"
            st.text_input("Name", entry.title, key=key, placeholder=placeholder, on_change=rename)
            for label, act in (("Duplicate", _duplicate), ("Remove", _remove)):
                button(label, f"{label.lower()}_{entry.id}", act, entry.id)


def _show_unreadable(entry: home.Listed) -> None:
    why = entry.unreadable or (
        "the file of this project is damaged. It is kept as it is. Open the project's last backup "
        "(its zip) below."
    )
    st.warning(f"{date_of(entry.changed)}: {escape_markdown(why)}")
    button("Remove", f"remove_{entry.id}", _remove, entry.id)


@callback
def _rename(project_id: str, key: str) -> None:
    Project.open(default_home(), project_id).rename(st.session_state[key].strip())


def _open(project_id: str) -> None:
    st.session_state[_OPENED] = project_id


def _duplicate(project_id: str) -> None:
    copy = home.duplicate(default_home(), project_id)
    if ServerSettings.from_environment().shared:  # there is no list to find it in
        open_project(copy.id)


def _remove(project_id: str) -> None:
    home.remove(default_home(), project_id)
    if not is_open(project_id):  # for the open one, `offer_removed` does
        st.session_state[_REMOVED] = project_id


def _show_removed(removed: Sequence[home.Listed]) -> None:
    with st.expander("Removed projects"):
        for entry in _of_page(removed, "removed_page"):
            text, place = st.columns([6, 2], vertical_alignment="center")
            title = escape_markdown(entry.title or "A damaged project")
            text.markdown(f"{title}, removed {date_of(entry.changed)}")
            back, delete = (partial(act, default_home()) for act in (home.bring_back, home.delete))
            hint = "Frees its space on the disk at once."
            with place, st.container(horizontal=True):
                button("Bring back", f"bring_back_{entry.id}", back, entry.id)
                button("Delete for good", f"delete_{entry.id}", delete, entry.id, help=hint)


def show_storage(project: Project | None) -> None:
    """Export of the open project, import of one, and what is stored for how long."""
    with st.expander("Take a project elsewhere, or open one from a zip"):
        if project is not None:
            name = title_of(project)
            if st.button(f"Pack the open project ({escape_markdown(name)})", key="pack"):
                with ErrorsShown():
                    _offer_packed(project, name)
        _open_zip()
    with st.expander("What is kept, where and for how long"):
        st.markdown(what_is_kept(ServerSettings.from_environment()))


def what_is_kept(settings: ServerSettings) -> str:
    """Where projects are stored, for how long, and their maximum size."""
    if settings.shared:
        where, back = "on the server", "by its address"
        who = (
            "Only those who have the address of a project (in the browser's address bar) can open "
            "it: keep it as a bookmark. There is no list."
        )
    else:
        where = f"on this computer, in `{default_home()}`"
        back = "from the list of removed projects on this page, or by its address"
        who = "A project is found in this list, and by its address in the browser."
    life = (
        "until you remove it"
        if math.isinf(settings.keep_days)
        else f"until nobody has changed it for {settings.keep_days:g} days"
    )
    size = (
        "Its size is limited only by the disk."
        if math.isinf(settings.project_mb)
        else f"One project may take {settings.project_mb:g} MB; photographs that you remove from "
        "it free space at once."
    )
    return (
        f"Every file, correction, setting and result is written to disk {where}, as soon as it is "
        f"there, and kept {life}. A removed project can be brought back for "
        f"{settings.undo_days:g} days, {back}. {size} {who} Nothing is sent elsewhere."
    )


def _open_zip() -> None:
    upload = st.file_uploader("A project's zip", type=["zip"], key="upload_project")
    if upload is None or not is_new(upload):
        return
    opened, remarks = "", list[str]()
    with taking(upload), ErrorsShown():
        unpacked: dict[str, str] = st.session_state.setdefault(_UNPACKED, {})
        if upload.file_id not in unpacked:
            check_uploads([upload])
            content, name = upload.getvalue(), upload.name
            project = unpack_project(content, name, default_home(), remarks.append)
            unpacked[upload.file_id] = project.id
        opened = unpacked[upload.file_id]
        open_project(opened)
    for remark in remarks:
        tell(remark, "info")
    if opened:
        st.switch_page("pages/data.py")


def _offer_packed(project: Project, name: str) -> None:
    """Pack the project in a temporary folder, because its own disk may be full or read-only."""
    settings, size = ServerSettings.from_environment(), project.database.size
    if size > settings.download_mb * MB:
        st.error(
            f"The project takes {size / MB:.1f} MB, and at most {settings.download_mb:g} MB "
            "(`STEREOCAL_DOWNLOAD_MB`) are packed for a browser, in the server's memory. The "
            f"command line reads its file, `projects/{project.id}.sqlite` below the server's home, "
            "as it is."
        )
        return
    # The last result, with the parameter files as *Calibrate* offers them.
    answer = final_answer(project)
    with st.spinner("Forecasting."):
        result = {} if answer is None else jobs.compute(lambda: answer.parameter_files)
    with tempfile.TemporaryDirectory() as folder:
        target = Path(folder) / "project.zip"
        with st.spinner("Packing."):
            pack_project(project, target, result)
        content = target.read_bytes()
    packed = len(content)
    in_words = f"{packed / MB:.1f} MB" if packed >= MB else f"{packed / 1e3:.0f} kB"
    file_name = re.sub("[^A-Za-z0-9-]+", "-", name).strip("-") or "project"
    offer(f"Download it ({in_words})", content, f"{file_name}.zip", "download_project")
    largest = st.get_option("server.maxUploadSize")
    if packed > largest * 2**20:
        st.caption(
            f"This page takes zips of {largest} MB at most: elsewhere, open it with a larger "
            "`STREAMLIT_SERVER_MAX_UPLOAD_SIZE`, or on the command line."
        )
