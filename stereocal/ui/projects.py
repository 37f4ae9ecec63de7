"""The projects on the Start page: recent and removed ones, export and import."""

from __future__ import annotations

import math
import os
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TypeVar

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.paper_kit.reproduction import archive_files
from stereocal.projects.archive import pack_project, unpack_project
from stereocal.projects.data_folder import default_home
from stereocal.projects.database import journal_of
from stereocal.projects.home import (
    delete,
    find_projects,
    listed,
    recent_projects,
    removed_at,
    removed_projects,
    title_of,
)
from stereocal.projects.project import Project
from stereocal.projects.server_settings import ServerSettings
from stereocal.system.limits import MB
from stereocal.ui.downloads import offer
from stereocal.ui.fields import Number, setting
from stereocal.ui.intake import check_uploads, escape_markdown, is_new, taking
from stereocal.ui.messages import callback, readable
from stereocal.ui.project import bring_project_back, current_project, offer_removed, open_project
from stereocal.ui.project_cards import OPENED, REMOVED, date_of, show_cards
from stereocal.ui.refined import answer_of

ON_A_PAGE = 9
T = TypeVar("T")
_UNPACKED = "unpacked_projects"
"""Ids of imported projects by upload: a click may interrupt the opening of one."""


def show_projects() -> Project | None:
    """The projects to open, rename, duplicate or remove, and removed ones to bring back.

    A shared server shows only the open project, and a removed one only under its address.

    Returns:
        The open project.
    """
    if opened := st.session_state.pop(OPENED, None):
        open_project(opened)
        st.switch_page("pages/data.py")
    settings = ServerSettings.from_environment()
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
    if not settings.shared:
        _offer_undo()
    if settings.shared:
        if project is not None:
            st.markdown("#### The open project")
            show_cards([listed(project)])
    else:
        _show_all()
        _show_removed()
    return project


def _show_all() -> None:
    """The projects, the one changed last first, page by page, and a search where they are many."""
    ids = find_projects(default_home())
    if not ids:
        return
    st.markdown("#### Your projects")
    search = ""
    if len(ids) > ON_A_PAGE:
        typed = setting(None, "projects_search", "", str)
        search = st.text_input(
            f"Search all {len(ids)} projects by name", width=400, **typed.widget()
        )
        ids = find_projects(default_home(), search) if search.strip() else ids
    if not ids:
        st.info(f"No project has “{escape_markdown(search.strip())}” in its name.")
    show_cards(recent_projects(default_home(), _of_page(ids, f"projects_page {search}")))


def _of_page(ids: Sequence[T], name: str) -> Sequence[T]:
    """Those of the chosen page, and the choice of another, if there are several.

    Args:
        name: of the choice: another search begins at its first page.
    """
    pages = -(-len(ids) // ON_A_PAGE)
    if pages < 2:
        return ids
    page = setting(None, name.split()[0], 1, Number(1, pages), name=name)
    chosen = st.pagination(pages, **page.widget())
    return ids[(chosen - 1) * ON_A_PAGE : chosen * ON_A_PAGE]


def show_storage(project: Project | None) -> None:
    """Export and import of projects, and what is stored for how long."""
    with st.expander("Take a project elsewhere, or open one from a zip"):
        _pack_and_unpack(project)
    with st.expander("What is kept, where and for how long"):
        st.markdown(what_is_kept(ServerSettings.from_environment()))


def what_is_kept(settings: ServerSettings) -> str:
    """Where projects are stored, for how long, and their maximum size."""
    where = "on the server" if settings.shared else f"on this computer, in `{default_home()}`"
    life = (
        "until you remove it"
        if math.isinf(settings.keep_days)
        else f"until nobody has changed it for {settings.keep_days:g} days"
    )
    who = (
        "Only those who have the address of a project (in the browser's address bar) can open it: "
        "keep it as a bookmark. There is no list."
        if settings.shared
        else "A project is found in this list, and by its address in the browser."
    )
    back = (
        "by its address"
        if settings.shared
        else "from the list of removed projects on this page, or by its address"
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


def _show_removed() -> None:
    removed = removed_projects(default_home())
    if not removed:
        return
    with st.expander("Removed projects"):
        for one in _of_page(removed, "removed_page"):
            text, button = st.columns([6, 2], vertical_alignment="center")
            title = escape_markdown(one.title or "A damaged project")
            text.markdown(f"{title}, removed {date_of(one.changed)}")
            with button, st.container(horizontal=True):
                st.button(
                    "Bring back",
                    key=f"bring_back_{one.id}",
                    on_click=bring_project_back,
                    args=(one.id,),
                )
                st.button(
                    "Delete for good",
                    key=f"delete_{one.id}",
                    on_click=callback(delete),
                    args=(default_home(), one.id),
                    help="Frees its space on the disk at once.",
                )


def _pack_and_unpack(project: Project | None) -> None:
    """Export the open project as a zip, and import one."""
    if project is not None:
        name = title_of(project)
        if st.button(f"Pack the open project ({escape_markdown(name)})", key="pack"):
            _offer_packed(project, name)
    upload = st.file_uploader("A project's zip", type=["zip"], key="upload_project")
    if upload is None or not is_new(upload):
        return
    with taking(upload):
        unpacked: dict[str, str] = st.session_state.setdefault(_UNPACKED, {})
        try:
            if upload.file_id not in unpacked:
                check_uploads([upload])
                opened = unpack_project(upload.getvalue(), upload.name, default_home())
                unpacked[upload.file_id] = opened.id
        except StereocalError as error:
            st.error(escape_markdown(str(error)))
            return
        open_project(unpacked[upload.file_id])
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
    try:
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / "project.zip"
            with st.spinner("Packing."):
                pack_project(project, target, _result(project))
            content = target.read_bytes()
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        return
    offer(
        f"Download it ({_size(len(content))})",
        content,
        f"{re.sub('[^A-Za-z0-9-]+', '-', name).strip('-') or 'project'}.zip",
        "download_project",
    )
    largest = st.get_option("server.maxUploadSize")
    if len(content) > largest * 2**20:
        st.caption(
            f"This page takes zips of {largest} MB at most: elsewhere, open it with a larger "
            "`STREAMLIT_SERVER_MAX_UPLOAD_SIZE`, or on the command line."
        )


def _result(project: Project) -> dict[str, bytes]:
    """The last result with the parameter files as *Calibrate* offers them; empty without one."""
    calibration = readable(lambda: project.calibration)
    answer = None if calibration is None else answer_of(project, calibration)
    if answer is None:
        return {}
    return archive_files(answer, answer.sets)


def _size(count: int) -> str:
    return f"{count / MB:.1f} MB" if count >= MB else f"{count / 1e3:.0f} kB"


def _offer_undo() -> None:
    removed = st.session_state.get(REMOVED)
    if removed is None:
        return
    project_id, name = removed
    if removed_at(default_home(), project_id) is None:  # brought back elsewhere, or deleted
        del st.session_state[REMOVED]
        return
    text, button = st.columns([6, 2], vertical_alignment="center")
    text.info(f"{escape_markdown(name or 'The project')} was removed.")
    button.button("Undo", key="undo_remove", on_click=bring_project_back, args=(project_id,))
