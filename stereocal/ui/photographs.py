"""Photographs on the Data page: upload, pairs, search for the targets."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePosixPath
from typing import Literal

import streamlit as st

from stereocal.detection.target import BAR, Target
from stereocal.errors import StereocalError
from stereocal.frames.pairing import Pair, pair_names
from stereocal.frames.search import STAGES, detect_frames, pack_detection, unpack_detection
from stereocal.frames.video.decoding import SUFFIXES as VIDEO_SUFFIXES
from stereocal.frames.video.extract import VideoSettings
from stereocal.projects.application import ProjectApplication
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.projects.recording import ProjectRecording
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.system.photograph import SUFFIXES
from stereocal.system.records import plain
from stereocal.ui import jobs
from stereocal.ui.archives import ask_about_archive
from stereocal.ui.boards import boards_in
from stereocal.ui.fields import choose
from stereocal.ui.holding import (
    ask_what_is_held,
    held_text,
    holds_board,
    is_stale,
    keep_what_was_found,
    propose_held,
)
from stereocal.ui.intake import (
    CAMERA_KINDS,
    GIVEN_AS,
    PHOTOGRAPHS,
    SEVERAL,
    SINGLE_FILES,
    TITLES,
    Upload,
    check_uploads,
    clear_refusal,
    escape_markdown,
    given_as,
    in_use,
    photographs_of,
    refuse,
    store_camera,
    take_photographs,
)
from stereocal.ui.messages import readable
from stereocal.ui.pairs import ROUND, clear, forget_base, show_pairs
from stereocal.ui.print_downloads import print_what_is_held
from stereocal.ui.project import project_to_write
from stereocal.ui.review import show_frames
from stereocal.ui.single_files import holds_both, take_camera
from stereocal.ui.uploads import free_memory
from stereocal.ui.videos import show_frames_taken, take_videos, video_settings

TOGETHER, FOLDER, APART = "Both cameras together", "A folder", "One camera after the other"
KINDS = [
    *sorted(suffix.removeprefix(".") for suffix in (*SUFFIXES, *VIDEO_SUFFIXES)),
    "zip",
    *CAMERA_KINDS,
]


def choose_kind(project: Project | None) -> str:
    """The kind of input data, as the project has some; photographs at first."""
    usual = PHOTOGRAPHS
    if project is not None:
        if ProjectRecording(project).parts:
            usual = SEVERAL
        elif "correspondences" in project.inputs.files and not has_photographs(project):
            usual = SINGLE_FILES
    how = given_as(project, usual)
    kind: str = st.segmented_control("I have", GIVEN_AS, required=True, **how.widget())
    return kind


def has_photographs(project: Project) -> bool:
    """Whether the project has photographs."""
    try:
        return bool(ProjectPhotographs(project).photographs)
    except StereocalError:  # reported where they are shown
        return True


def photographs_in(project: Project | None) -> None:
    """The uploaders, the pairs and the targets found."""
    ways = (TOGETHER, FOLDER, APART)
    how = choose(project, "photographs_how", "They come as", ways)
    key = f"upload_photographs_{st.session_state.setdefault(ROUND, 0)}"
    given: list[tuple[str, Upload]] = []
    if how == APART:
        for camera, column in zip(CAMERAS, st.columns(2), strict=True):
            uploads = column.file_uploader(
                f"Photographs of the {camera} camera, a zip of them, or its video",
                type=KINDS,
                accept_multiple_files=True,
                key=f"{key}_{camera}",
            )
            given += [(f"{camera}/", upload) for upload in uploads]
    elif how == FOLDER:
        folder = st.file_uploader(
            "Folder with the photographs", accept_multiple_files="directory", key=f"{key}_folder"
        )
        given = [("", upload) for upload in folder if kind_of(upload.name) == "photograph"]
        if folder and not given:
            refuse(StereocalError("There is no photograph among these files."))
    else:
        uploads = st.file_uploader(
            "Photographs of both cameras, a zip of them, or two videos; with the camera files, if "
            "you have them",
            type=KINDS,
            accept_multiple_files=True,
            key=key,
            help="Give both photographs of a frame the same name, apart from the camera: left07.png"
            " and right07.png, or cam0/07.png and cam1/07.png in a zip. Likewise left.mp4 and "
            "right.mp4, left.json and right.json.",
        )
        given = [("", upload) for upload in uploads]
    settings = video_settings(project)
    _take(given, settings)
    print_what_is_held(project, _focal_px(project) if project else None)
    if project is None:
        return
    show_frames_taken(project)
    _camera_files(project)
    store = ProjectPhotographs(project)
    try:
        if store.photographs:
            show_pairs(store)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        st.button("Remove all photographs", on_click=clear, args=(store,), key="no_photographs")
        return
    try:
        if store.photographs:
            _find_targets(store)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))


def _focal_px(project: Project) -> float | None:
    """The smaller focal length of the two cameras; None if one is not there or not readable."""
    cameras = readable(lambda: project.cameras) or (None, None)
    focal = [float(min(camera.K[0, 0], camera.K[1, 1])) for camera in cameras if camera]
    return min(focal) if len(focal) == 2 else None


def _camera_files(project: Project) -> None:
    """The lenses in use, and uploaders, folded once both are there."""
    for slot, column in zip(CAMERAS, st.columns(2), strict=True):
        with column:
            in_use(project, slot)
    lacking = not all(readable(lambda: project.cameras) or ()) and not holds_board(project)
    with st.expander("Camera files", expanded=lacking):
        for slot, column in zip(CAMERAS, st.columns(2), strict=True):
            key = f"upload_{slot}"
            with column:
                take_camera(slot, st.file_uploader(TITLES[slot], type=CAMERA_KINDS, key=key))
        st.page_link("pages/cameras.py", label="Or make them from photographs of a board")
    ask_about_archive(ProjectApplication(project))


def kind_of(name: str) -> Literal["photograph", "camera", "video"]:
    """What an upload is, by its name."""
    suffix = PurePosixPath(name).suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        return "video"
    return "camera" if suffix.removeprefix(".") in CAMERA_KINDS else "photograph"


def _take(given: Sequence[tuple[str, Upload]], settings: VideoSettings) -> None:
    """Store uploads by what they are, and free their memory.

    Args:
        given: each with the folder of its camera; empty if its name tells the camera.
    """
    kinds: dict[str, list[tuple[str, Upload]]] = {"photograph": [], "camera": [], "video": []}
    both_cameras: list[Upload] = []
    for folder, upload in given:
        kind = kind_of(upload.name)
        if kind == "camera" and holds_both(upload):
            both_cameras.append(upload)
        else:
            kinds[kind].append((folder, upload))
    if not given or (len(kinds["video"]) == len(given) == 1 and given[0][0]):
        return  # the other camera's video is still to come
    uploads = [upload for _, upload in given]
    clear_refusal()
    try:
        check_uploads(uploads)
        cameras, videos = by_camera(kinds["camera"]), by_camera(kinds["video"])
        if len(videos) == 1:
            raise StereocalError("Give the videos of both cameras together.")
        if kinds["photograph"]:
            store = ProjectPhotographs(project_to_write())
            contents = (
                item
                for folder, upload in kinds["photograph"]
                for item in photographs_of([upload], folder)
            )
            take_photographs(contents, store)
            with st.spinner("Looking at the first photographs ..."):
                propose_held(store)
        for slot, upload in cameras.items():
            store_camera(slot, upload.name, upload.getvalue())
        for upload in both_cameras:
            name, content = upload.name, upload.getvalue()
            ProjectApplication(project_to_write()).ask("archive", name, content)
        if videos:
            take_videos([videos[camera] for camera in CAMERAS], settings)
    except StereocalError as error:
        refuse(error)
    forget_base()
    # A new key empties the uploader, which otherwise keeps every file in memory.
    free_memory(uploads)
    st.session_state[ROUND] += 1
    st.rerun()


def by_camera(given: Sequence[tuple[str, Upload]]) -> dict[CameraName, Upload]:
    """The one file of each camera, the primary's first, told apart by folders or names.

    Raises:
        StereocalError: the names do not tell.
    """
    files = {f"{folder}file" if folder else upload.name: upload for folder, upload in given}
    pairing = pair_names(files)
    found: dict[CameraName, Upload] = {}
    for pair in pairing.pairs[:1]:
        found = {"primary": files[pair.primary], "secondary": files[pair.secondary]}
    for alone in pairing.alone[:1]:
        found[CAMERAS[alone.camera]] = files[alone.name]
    if len(found) < len(given) or pairing.ambiguous:
        names = " and ".join(upload.name for _, upload in given)
        raise StereocalError(
            f"Which camera is which does not show in {names}: name both files alike but for the "
            "camera, such as left.mp4 and right.mp4, or give one camera after the other."
        )
    return found


def _find_targets(store: ProjectPhotographs) -> None:
    """The search for targets, and its results."""
    project, rows = store.project, [row for row in store.rows if row.use]
    running = jobs.is_running(project, "photographs")
    frames = readable(lambda: store.frames)
    lacking = [name for name, camera in zip(CAMERAS, project.cameras, strict=True) if not camera]
    target = ask_what_is_held(store, rows[0].pair if rows else None, frames is not None)
    if holds_board(project):
        boards_in(store)
        return
    if lacking:
        st.info(
            f"Give the camera file of the {' and the '.join(lacking)} camera too: lenses are needed"
            " to tell A from B."
        )
    work = _work(store, [row.pair for row in rows], target or BAR)
    jobs.start_button(
        work,
        "Find the targets" if frames is None else "Find the targets again",
        "find_targets",
        primary=frames is None,
        disabled=bool(lacking) or not rows or target is None,
    )
    # The cheap test first: the digest of thousands of pairs is slow.
    if frames is not None and jobs.can_go_on(work) and store.found_by == work.digest:
        jobs.discard(project, "photographs")
    last = "Cancelled. What was found before is unchanged."
    jobs.show_job(project, "photographs", last, work)
    if frames is None:
        return
    if {(f.frame, f.files) for f in frames} != {
        (row.pair.frame, (row.pair.primary, row.pair.secondary)) for row in rows
    }:
        st.warning(
            "The pairs or their photographs have changed since the targets were found. Find them "
            "again."
        )
    elif is_stale(project):
        st.warning("These are the targets of what you said before that you hold. Find them again.")
    show_frames(store, frames, running)


def _work(store: ProjectPhotographs, pairs: Sequence[Pair], target: Target) -> jobs.Work:
    files = {name: path.name for name, path in store.photographs.items()}
    held = held_text(store.project)
    about = {
        "pairs": [[p.frame, *((n, files.get(n)) for n in (p.primary, p.secondary))] for p in pairs],
        "cameras": [camera and camera.to_json() for camera in store.project.cameras],
        **({} if target == BAR else {"target": plain(target)}),
    }
    return jobs.Work(
        store.project,
        "photographs",
        STAGES,
        about,
        lambda job: _find(store, pairs, target, held, job),
    )


def _find(
    store: ProjectPhotographs, pairs: Sequence[Pair], target: Target, held: str, job: jobs.Job
) -> bool:
    primary, secondary = store.project.cameras
    if primary is None or secondary is None:
        raise StereocalError("A camera file was removed from the project; give it again.")
    cameras = (primary, secondary)
    searched = store.photographs
    found = detect_frames(
        pairs,
        searched,
        cameras,
        job.executor,
        job.begin,
        job.progress,
        lambda: job.cancelled,
        pieces=job.checkpoints("detections", pack_detection, unpack_detection),
        target=target,
    )
    if found is None:
        return False
    keep_what_was_found(store.project, held)
    store.keep_found(found, searched, job.digest)
    return True
