"""The Data page for three cameras and more: their files, and one table of points or photographs."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial

import pandas as pd
import streamlit as st

from stereocal.errors import StereocalError
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.archives.all_cameras import Gathered, cameras_in, gather_all, targets_in
from stereocal.formats.archives.gather import is_table
from stereocal.formats.dataset_description import POINTS
from stereocal.formats.dataset_files import pack_recording
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.points_csv import write_points
from stereocal.frames.all_cameras import Found, by_folder
from stereocal.frames.pairing import Pairing, natural
from stereocal.projects.application import ProjectApplication
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import Camera
from stereocal.rig.recording import Recording
from stereocal.system.latest import once
from stereocal.system.made_from import Parts, changed
from stereocal.system.numbers import count
from stereocal.ui import jobs
from stereocal.ui.holding import settle
from stereocal.ui.intake import give_pair
from stereocal.ui.lengths import ask_lengths, ask_places
from stereocal.ui.menu import PRESS_FIRST
from stereocal.ui.messages import button, readable, show_stale, show_with_button
from stereocal.ui.navigation import go_to
from stereocal.ui.press import press
from stereocal.ui.search import ask_held, press_search, search_work
from stereocal.ui.texts import escape_markdown, escaped_table
from stereocal.ui.videos import show_frames_taken
from stereocal.ui.wizard import Questions

UNUSED, TOLD = "several_unused", "several_told"


def show_all_cameras(project: Project) -> None:
    """Three cameras and more: their files, the questions about them, what was read, the lengths."""
    if ProjectGiven(project).parts:
        _show_files(project)
    elif (given := project.recording_as_given) is not None:
        _show_recording(given, [])
        ask_lengths(project, given)


def _show_files(project: Project) -> None:
    """The files, the questions, what was read, and the press."""
    store = ProjectGiven(project)
    _show_parts(store)
    show_frames_taken(project)
    if jobs.is_running(project, "video"):
        return
    parts = dict(sorted(store.parts.items(), key=lambda each: natural(each[0])))
    files = {name: part for name, part in parts.items() if not is_table(name, part.read_bytes())}
    if len(files) == 1:
        button("Use only two of these cameras", "several_two", _use_two, store, *files)
    asked = Questions(project, "several_{}")
    with st.expander("Correct or complete what the files say"):
        left, right = st.columns(2)
        lens_model, corner = asked.ask(left, "lens_model"), asked.ask(right, "corner")
    options = ExchangeOptions(lens_model=lens_model, corner=corner)
    cameras = readable(lambda: cameras_in(_contents(files), options), told=False) or {}
    given = len(cameras) > 2 and _photographs_of_all(project, cameras)
    if given and len(files) == len(parts):
        return  # the table is still to be made from them
    try:
        found = _read(project, parts, options)
    except StereocalError as error:
        st.warning(escape_markdown(str(error)))
        return
    _show_recording(found.recording, found.remarks)
    ask_lengths(project, found.recording)
    title = "Calibrate all" if len(found.recording.cameras) > 2 else "Use these points"
    # Of what is in use already, the next thing to do is on the page Calibrate.
    is_used = project.is_given(found.files)
    st.session_state[PRESS_FIRST] = not is_used
    button(title, "several_run", _calibrate, store, found, first=not is_used)


def _use_two(store: ProjectGiven, name: str) -> None:
    """Ask which two cameras of a file of all to use, and of the table (a callback)."""
    asked = ProjectApplication(store.project)
    for part, content in _contents(store.parts).items():
        asked.ask("archive" if part == name else "bars", part, content)
        store.drop_part(part)


def _show_parts(store: ProjectGiven) -> None:
    """The files in use, to remove, and those that replaced one."""
    with st.container(horizontal=True):
        for name in sorted(store.parts, key=natural):
            act = f"drop_{name}", store.drop_part, name
            button(escape_markdown(name), *act, icon="close", help="Remove this file.")
    for name in store.replaced:
        undo = "Undo", f"undo_{name}", store.undo_part, name
        show_with_button("info", f"{name} was replaced.", *undo, icon="undo")


def _contents(files: Mapping[str, StoredFile]) -> dict[str, bytes]:
    return {name: file.read_bytes() for name, file in files.items()}


def _read(project: Project, parts: dict[str, StoredFile], options: ExchangeOptions) -> Gathered:
    """The recording of the files, and of what is answered about them."""
    name, lengths = project.inputs.name or "Rig", dict[str, float]()
    for table, part in parts.items():
        if is_table(table, part.read_bytes()):
            lengths |= ask_places(project, targets_in(part.read_bytes(), table))
    about = [(each, file.sha256) for each, file in parts.items()]
    return once(
        "files of all cameras",
        repr((about, options, lengths, name)),
        lambda: gather_all(_contents(parts), options, name, lengths),
    )


def _show_recording(recording: Recording, remarks: Sequence[str]) -> None:
    """What was read, camera by camera."""
    rows = []
    for number_of, (name, camera) in enumerate(recording.cameras.items()):
        frames = recording.frame[recording.camera == number_of]
        width, height = camera.image_size
        rows.append((name, f"{width}x{height}", f"{len(frames):,}", f"{len({*frames.tolist()}):,}"))
    table = pd.DataFrame(rows, columns=["Camera", "Image, px", "Points", "Frames"])
    st.table(escaped_table(table).set_index("Camera"))
    st.caption(escape_markdown(recording.describe_pairs()))
    for remark in remarks:
        st.warning(escape_markdown(remark))


def _calibrate(store: ProjectGiven, gathered: Gathered) -> None:
    """Store the recording and go on with it: calibrate a rig, or open a pair (a callback)."""
    recording = gathered.recording
    if len(recording.cameras) == 2:
        known = store.project.inputs.of_rig(recording)
        give_pair(store.project, pair_to_calibrate(known))
        for name in store.parts:
            store.drop_part(name)
        return
    store.project.give_recording(recording, gathered.files, same_lengths=True)
    jobs.drop_pairs(store.project)
    press(store.project)
    go_to("calibrate")


def _photographs_of_all(project: Project, cameras: Mapping[str, Camera]) -> bool:
    """How many photographs there are of each camera, and the search; whether there are any."""
    store = ProjectPhotographs(project)
    folders = by_folder(store.photographs, cameras)
    counts = ", ".join(f"{camera} {len(own) or 'none'}" for camera, own in folders.items())
    if not any(folders.values()):
        return False
    words, remove = f"Photographs: {counts}.", "Remove all photographs"
    show_with_button("markdown", words, remove, "several_clear", store.clear)
    pairing = readable(lambda: store.pairing([*cameras]), told=all(folders.values()))
    if pairing is not None:
        _search(store, cameras, pairing)
    return True


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
