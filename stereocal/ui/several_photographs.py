"""Photographs of three cameras and more on the Data page: upload, and search for the targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import cycle

import streamlit as st

from stereocal.detection.target import Target
from stereocal.formats.recording_files import POINTS, pack_recording, write_points
from stereocal.frames.search import STAGES, pack_detection, unpack_detection
from stereocal.frames.several import Moments, by_folder, find_everywhere, match_names, pairs_of
from stereocal.intrinsics.files import pack_board, unpack_board
from stereocal.intrinsics.stereo_boards import BOARDS_STAGE, boards_everywhere
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import Camera
from stereocal.system.photograph import SUFFIXES
from stereocal.system.records import plain
from stereocal.ui import jobs
from stereocal.ui.boards import USUAL
from stereocal.ui.holding import ask_what_is_held, holds_board, propose_held
from stereocal.ui.intake import (
    Upload,
    clear_refusal,
    escape_markdown,
    is_new,
    photographs_of,
    take_photographs,
    taking,
)
from stereocal.ui.lens import board_form
from stereocal.ui.messages import callback, readable

KINDS = [*sorted(suffix.removeprefix(".") for suffix in SUFFIXES), "zip"]
FOUND_BY, UNUSED = "several_found_by", "several_unused"
_LOOKED = "several_photographs_looked"


def photographs_of_all(project: Project, cameras: Mapping[str, Camera]) -> bool:
    """The uploaders, one for each camera, and the search; whether there are photographs."""
    store = ProjectPhotographs(project)
    folders = by_folder(store.photographs, cameras)
    with st.expander("Photographs of all cameras", expanded=not all(folders.values())):
        for number, (camera, place) in enumerate(zip(cameras, cycle(st.columns(3)), strict=False)):
            # Of its own for each: others may be receiving files meanwhile.
            key = f"upload_of_camera_{number}"
            uploads = place.file_uploader(
                f"{escape_markdown(camera)}: {len(folders[camera]) or 'no'} photographs",
                type=KINDS,
                accept_multiple_files=True,
                key=f"{key}_{st.session_state.setdefault(key, 0)}",
                help="Or a zip of them. Name those of one moment alike, apart from the camera.",
            )
            _take(store, camera, uploads, key)
        if any(folders.values()):
            clear = callback(store.clear)
            st.button("Remove all photographs", on_click=clear, key="several_clear")
    if not any(folders.values()):
        return False
    moments = readable(lambda: match_names(folders), told=all(folders.values()))
    if moments is not None:
        _search(store, cameras, moments)
    return True


def _take(store: ProjectPhotographs, camera: str, uploads: Sequence[Upload], key: str) -> None:
    fresh = [upload for upload in uploads if is_new(upload)]
    if fresh:
        with taking(*fresh):
            clear_refusal()
            take_photographs(photographs_of(fresh, f"{camera}/"), store)
        st.session_state[key] += 1  # empties the uploader
        st.rerun()


def _search(store: ProjectPhotographs, cameras: Mapping[str, Camera], moments: Moments) -> None:
    """What is held, the press, and what was not found."""
    project, pairs = store.project, pairs_of(moments, *[*next(iter(moments.values()))][:2])
    found_by = project.settings.get(FOUND_BY)
    files = {name: path.name for name, path in store.photographs.items()}
    complete = {name for own in moments.values() for name in own} == {*cameras}
    if complete and st.session_state.get(_LOOKED) != files:
        with st.spinner("Looking at the first photographs ..."):
            propose_held(store, pairs)
        st.session_state[_LOOKED] = files
    target: Target | BoardPattern | None = ask_what_is_held(store, pairs[0], found_by is not None)
    entered = True
    if holds_board(project):
        target = readable(lambda: board_form(project, USUAL, square_mm=None))
        entered = project.settings.get("board_square_mm") is not None
        if not entered:
            st.info("Enter the side of a square as measured: all lengths follow from it.")
    about = {
        "photographs": [
            {"frame": k, **{c: files[n] for c, n in own.items()}} for k, own in moments.items()
        ],
        "cameras": {name: camera.to_json() for name, camera in cameras.items()},
        "target": None if target is None else [type(target).__name__, plain(target)],
    }
    work = jobs.Work(
        project,
        "photographs",
        (BOARDS_STAGE,) if holds_board(project) else STAGES,
        about,
        lambda job: target is not None and _find(store, cameras, moments, target, job),
    )
    jobs.start_button(
        work,
        "Find the targets" if found_by is None else "Find the targets again",
        "find_everywhere",
        primary=found_by is None,
        disabled=target is None or not entered,
    )
    jobs.show_job(project, "photographs", "Cancelled. What was found before is unchanged.", work)
    if found_by is None:
        return
    if found_by != work.digest:
        st.warning("The photographs, the cameras or what is held have changed. Find them again.")
    unused = project.settings.get(UNUSED) or []
    st.caption(f"{len(moments)} frames. Photographs not used: {len(unused)}.")
    if unused:
        with st.expander("Photographs that are not used"):
            st.markdown("\n".join(f"- {escape_markdown(line)}" for line in unused))


def _find(
    store: ProjectPhotographs,
    cameras: Mapping[str, Camera],
    moments: Moments,
    target: Target | BoardPattern,
    job: jobs.Job,
) -> bool:
    """Find the targets and store their table, of boards the whole recording."""
    project, photographs = store.project, store.photographs
    several = ProjectRecording(project)
    begin, progress, stopped = job.begin, job.progress, lambda: job.cancelled
    if isinstance(target, BoardPattern):
        pieces = job.checkpoints("boards", pack_board, unpack_board)
        found = boards_everywhere(
            moments, photographs, cameras, target, job.executor, begin, progress, stopped, pieces
        )
    else:
        seen = job.checkpoints("detections", pack_detection, unpack_detection)
        found = find_everywhere(
            moments, photographs, cameras, target, job.executor, begin, progress, stopped, seen
        )
    if found is None:
        return False
    if isinstance(target, BoardPattern):
        recording = replace(found.recording, name=project.inputs.name or "Rig")
        several.give(pack_recording(recording), recording.name)
    else:
        several.add_parts({POINTS: write_points(found.recording)})
    project.keep_settings({FOUND_BY: job.digest, UNUSED: [*found.unused]})
    return True
