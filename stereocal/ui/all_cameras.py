"""Photographs of three cameras and more on the Data page: the search for the targets in them."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

import streamlit as st

from stereocal.formats.dataset_description import POINTS
from stereocal.formats.dataset_files import pack_recording
from stereocal.formats.points_csv import write_points
from stereocal.frames.all_cameras import Found, by_folder
from stereocal.frames.pairing import Pairing
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import Camera
from stereocal.system.made_from import Parts, changed
from stereocal.system.numbers import count
from stereocal.ui import jobs
from stereocal.ui.holding import settle
from stereocal.ui.messages import readable, show_stale, show_with_button
from stereocal.ui.search import ask_held, press_search, search_work
from stereocal.ui.texts import escape_markdown

UNUSED, TOLD = "several_unused", "several_told"


def photographs_of_all(project: Project, cameras: Mapping[str, Camera]) -> None:
    """How many photographs there are of each camera, and the search."""
    store = ProjectPhotographs(project)
    folders = by_folder(store.photographs, cameras)
    counts = ", ".join(f"{camera} {len(own) or 'none'}" for camera, own in folders.items())
    if not any(folders.values()):
        return
    words, remove = f"Photographs: {counts}.", "Remove all photographs"
    show_with_button("markdown", words, remove, "several_clear", store.clear)
    pairing = readable(lambda: store.pairing([*cameras]), told=all(folders.values()))
    if pairing is not None:
        _search(store, cameras, pairing)


def _search(store: ProjectPhotographs, cameras: Mapping[str, Camera], pairing: Pairing) -> None:
    """What is held, the press, and what was not found."""
    project = store.project
    is_searched = bool(store.found_in)
    held, ready = ask_held(store, pairing, is_searched)
    work = search_work(store, pairing, cameras, held, partial(_keep, store))
    press_search(work, "targets", "find_in_all_cameras", is_searched, ready)
    if not is_searched:
        if pairing.sentence:
            st.caption(pairing.sentence)
        return
    show_stale(changed(store.found_in, work.made_from))
    unused = project.settings.get(UNUSED) or []
    told = project.settings.get(TOLD) or f"{count(len(pairing.moments), 'frame')}."
    st.caption(f"{escape_markdown(str(told))} Photographs not used: {len(unused):,}.")
    if unused:
        with st.expander("Photographs that are not used"):
            st.markdown("\n".join(f"- {escape_markdown(line)}" for line in unused))


def _keep(store: ProjectPhotographs, found: Found, made_from: Parts) -> None:
    """Store the table of the targets that were found, of boards the whole recording."""
    project = store.project
    if found.recording.object.board is not None:
        whole = replace(found.recording, name=project.inputs.name or "Rig")
        project.give_recording(whole, pack_recording(whole), same_lengths=True)
        jobs.drop_pairs(project)
    else:
        ProjectGiven(project).add_parts({POINTS: write_points(found.recording)})
    store.keep_found_in(made_from)
    project.keep_settings({UNUSED: [*found.unused], TOLD: found.pairing.sentence})
    settle(project)
