"""Photographs on the Data page: upload, pairs, search for the targets."""

from collections.abc import Sequence
from functools import partial
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
from stereocal.system.records import plain
from stereocal.ui import holding, intake, jobs
from stereocal.ui.archives import ask_about_archive, holds_both, single_file
from stereocal.ui.boards import boards_in, press_search
from stereocal.ui.fields import choose
from stereocal.ui.intake import CAMERA_KINDS, Upload
from stereocal.ui.messages import ErrorsShown, readable, refuse, show_stale
from stereocal.ui.pairing import show_pairing
from stereocal.ui.pairs import ROUND, clear
from stereocal.ui.print_downloads import print_what_is_held
from stereocal.ui.project import project_to_write
from stereocal.ui.review import show_frames
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import show_frames_taken, take_videos, video_settings

TOGETHER, FOLDER, APART = "Both cameras together", "A folder", "One camera after the other"
VIDEO_KINDS = sorted(suffix.removeprefix(".") for suffix in VIDEO_SUFFIXES)
KINDS = [*intake.PHOTOGRAPH_KINDS, *VIDEO_KINDS, *CAMERA_KINDS]


def choose_kind(project: Project | None) -> str:
    """The kind of input data, as the project has some; photographs at first."""
    usual = intake.PHOTOGRAPHS
    if project is not None:
        if ProjectRecording(project).parts:
            usual = intake.SEVERAL
        elif "correspondences" in project.inputs.files and not has_photographs(project):
            usual = intake.SINGLE_FILES
    return str(intake.given_as(project, usual).buttons("I have"))


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
    settings, every = video_settings(project), [upload for _, upload in given]
    # One video of one camera: that of the other is still to come.
    if len(given) != 1 or not given[0][0] or kind_of(given[0][1].name) != "video":
        intake.take_uploads(every, lambda _: _store(given, settings), ROUND)
    cameras = readable(lambda: project.cameras) if project else None
    focal = [float(min(one.K[0, 0], one.K[1, 1])) for one in cameras or () if one]
    print_what_is_held(project, min(focal) if len(focal) == 2 else None)
    if project is None:
        return
    show_frames_taken(project)
    _camera_files(project)
    store = ProjectPhotographs(project)
    try:
        if store.photographs:
            show_pairing(store)
    except StereocalError as error:
        st.error(escape_markdown(str(error)))
        st.button("Remove all photographs", on_click=clear, args=(store,), key="no_photographs")
        return
    with ErrorsShown():
        if store.photographs:
            _find_targets(store)


def _camera_files(project: Project) -> None:
    """The lenses in use, and uploaders, folded once both are there."""
    for slot, column in zip(CAMERAS, st.columns(2), strict=True):
        with column:
            intake.in_use(project, slot)
    known = all(readable(lambda: project.cameras) or ())
    with st.expander("Camera files", expanded=not known and not holding.holds_board(project)):
        for slot, column in zip(CAMERAS, st.columns(2), strict=True):
            with column:
                single_file(slot)
        st.page_link("pages/cameras.py", label="Or make them from photographs of a board")
    ask_about_archive(project)


def kind_of(name: str) -> Literal["photograph", "camera", "video"]:
    """What an upload is, by its name."""
    suffix = PurePosixPath(name).suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        return "video"
    return "camera" if suffix.removeprefix(".") in CAMERA_KINDS else "photograph"


def _store(given: Sequence[tuple[str, Upload]], settings: VideoSettings) -> None:
    """Store uploads by what they are.

    Args:
        given: each with the folder of its camera; empty if its name tells the camera.
    """
    of_kind: dict[str, list[tuple[str, Upload]]] = {"photograph": [], "camera": [], "video": []}
    archives: list[Upload] = []
    for folder, upload in given:
        kind = kind_of(upload.name)
        if kind == "camera" and holds_both(upload.name, upload.getvalue()):
            archives.append(upload)
        else:
            of_kind[kind].append((folder, upload))
    cameras, videos = by_camera(of_kind["camera"]), by_camera(of_kind["video"])
    if len(videos) == 1:
        raise StereocalError("Give the videos of both cameras together.")
    if photographs := of_kind["photograph"]:
        store = ProjectPhotographs(project_to_write())
        contents = (
            item for folder, one in photographs for item in intake.photographs_of([one], folder)
        )
        intake.take_photographs(contents, store)
        with st.spinner("Looking at the first photographs ..."):
            holding.propose_held(store)
    for slot, upload in cameras.items():
        intake.store_camera(slot, upload.name, upload.getvalue())
    for upload in archives:
        application = ProjectApplication(project_to_write())
        application.ask("archive", upload.name, upload.getvalue())
    if videos:
        take_videos([videos[camera] for camera in CAMERAS], settings)


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
    first = rows[0].pair if rows else None
    target = holding.ask_what_is_held(store, first, frames is not None)
    if holding.holds_board(project):
        boards_in(store)
        return
    if lacking:
        st.info(
            f"Give the camera file of the {' and the '.join(lacking)} camera too: lenses are needed"
            " to tell A from B."
        )
    work = _work(store, [row.pair for row in rows], target or BAR)
    # The cheap test first: the digest of thousands of pairs is slow.
    if frames is not None and jobs.can_go_on(work) and store.found_by == work.digest:
        jobs.discard(project, "photographs")
    ready = bool(rows) and not lacking and target is not None
    press_search(work, "targets", "find_targets", frames is not None, ready)
    if frames is None:
        return
    if {(f.frame, f.files) for f in frames} != {
        (row.pair.frame, (row.pair.primary, row.pair.secondary)) for row in rows
    }:
        show_stale("pairs or photographs")
    elif project.settings.get(holding.FOUND, "bar2x2") != holding.held_text(project):
        show_stale("what you hold")
    show_frames(store, frames, running)


def _work(store: ProjectPhotographs, pairs: Sequence[Pair], target: Target) -> jobs.Work:
    files = {name: path.name for name, path in store.photographs.items()}
    about = {
        "pairs": [[p.frame, *((n, files.get(n)) for n in (p.primary, p.secondary))] for p in pairs],
        "cameras": [camera and camera.to_json() for camera in store.project.cameras],
        **({} if target == BAR else {"target": plain(target)}),
    }
    run = partial(_find, store, pairs, target, holding.held_text(store.project))
    return jobs.Work(store.project, "photographs", STAGES, about, run)


def _find(
    store: ProjectPhotographs, pairs: Sequence[Pair], target: Target, held: str, job: jobs.Job
) -> bool:
    primary, secondary = store.project.cameras
    if primary is None or secondary is None:
        raise StereocalError("A camera file was removed from the project; give it again.")
    searched = store.photographs
    found = detect_frames(
        pairs,
        searched,
        (primary, secondary),
        job.executor,
        job.begin,
        job.progress,
        lambda: job.cancelled,
        pieces=job.checkpoints("detections", pack_detection, unpack_detection),
        target=target,
    )
    if found is None:
        return False
    store.project.keep_settings({holding.FOUND: held})
    store.keep_found(found, searched, job.digest)
    return True
