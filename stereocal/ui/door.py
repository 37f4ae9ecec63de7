"""The Data page's one place for files: what each is used for, and what is asked about them."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import streamlit as st

from stereocal.errors import StereocalError
from stereocal.fit.rig_file import RigFile
from stereocal.formats.archives.all_cameras import names_cameras
from stereocal.formats.archives.gather import is_correspondences, with_one_table
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import TEMPLATE
from stereocal.formats.dropped import Dropped
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.point_answers import layout_of
from stereocal.formats.point_text import point_text
from stereocal.frames.several_cameras import chapters_in_words
from stereocal.frames.which_camera import Series, which_camera, which_of
from stereocal.projects.application import ProjectApplication
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.inputs import Slot
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.ui import intake
from stereocal.ui.downloads import offer
from stereocal.ui.fields import page_shown
from stereocal.ui.holding import holds_board
from stereocal.ui.intake import drop_zone
from stereocal.ui.messages import button, readable, show_refusal, show_with_button
from stereocal.ui.parameter_files import ask_about_archive
from stereocal.ui.prerequisites import missing_of
from stereocal.ui.project import current_project, project_to_write
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import take_videos, video_settings
from stereocal.ui.wizard import ask_about_bars

LABEL = (
    "Drop photographs, videos, a zip, tables, camera files of both (or all) cameras here, together "
    "or one after the other"
)
CAN_BE_GIVEN = """
- **Photographs** of both cameras (PNG, JPEG, TIFF, BMP, PGM), or a **video** of each (MP4, MOV,
  AVI, MKV). Names such as left07 and right07, or a folder for each camera, tell
  which camera took what; otherwise you are asked once.
- **Camera files**, one for each camera or one of both: stereocal, OpenCV, Kalibr, ROS, MATLAB,
  aniposelib, Caliscope. Without any, make them on the page *Lenses*.
- Instead of photographs, a **table** of the bar's ends (CSV): ours, or of Argus, easyWand, DLTdv.
- **Three cameras and more**: the camera files of all, and one table or the photographs. `rig.json`
  serves as the camera files of all.
- A **zip** or a folder of any of these, also with `dataset.json`.
"""
SLOTS: Mapping[Slot, str] = {
    "correspondences": "",
    "primary": " (primary camera)",
    "secondary": " (secondary camera)",
}
_VIDEOS = "videos_waiting"
UseVideos = Callable[[Mapping[str, tuple[str, bytes]]], None]
"""Takes the name and the content of the video of each camera, the primary's first."""
BOTH = ("The primary camera", "The secondary camera")
TOOK = "Which camera took {}?"
REMOVE = "Remove all photographs"


def data_door(project: Project | None) -> None:
    """The place for files, what they were, and the questions about them."""
    zone, row, below = st.container(), st.container(horizontal=True), st.container()
    with row.popover("What can I give?"):
        st.markdown(CAN_BE_GIVEN)
        offer("Template for the table", TEMPLATE, "correspondences.csv", "template")
    with row.popover("Frames of videos"):
        use_videos = partial(take_videos, settings=video_settings(project))
    take = partial(_take, use_videos=use_videos)
    cameras = CAMERAS if project is None else ProjectGiven(project).rig_cameras or CAMERAS
    with zone:
        keep, used = partial(_keep, []), _in_use(project)
        drop_zone(LABEL, "upload_data", keep, take, row=row, below=below, in_use=bool(used))
    with below:
        show_refusal()
        if project is not None:
            _show_state(ProjectGiven(project), used)
            ask_whose(ProjectGiven(project))
            ask_about_bars(ProjectApplication(project))
            ask_about_archive(project)
        ask_whose_video(use_videos, cameras, len(cameras))


def _in_use(project: Project | None) -> list[str]:
    """What is in use, in words."""
    if project is None:
        return []
    labels = project.inputs.labels
    used = [labels[slot] + words for slot, words in SLOTS.items() if slot in labels]
    with suppress(StereocalError):  # damaged: reported where they are shown
        if counts := ProjectGiven(project).photographs_in_words:
            used.append(counts)
    return used


def _show_state(project_files: ProjectGiven, used: Sequence[str]) -> None:
    """What is in use, and what is still missing."""
    project = project_files.project
    if not used:
        return
    st.caption(f"In use: {escape_markdown(', '.join(used))}")
    if project_files.of_more_than_two or project_files.is_undivided:
        return
    slips = readable(lambda: ProjectPhotographs(project).slips, warn=False)
    if slips is None and (missing := missing_of(project)):  # else it is said with the photographs
        st.warning(f"Still missing: {missing}.")
    if not all(readable(lambda: project.cameras) or ()) and not holds_board(project):
        st.page_link("pages/cameras.py", label="No camera files? Make them from a board")


def _keep(opened: list[Project], name: str, content: bytes) -> StoredFile:
    """Store a photograph in the project, which the first one opens."""
    if not opened:
        opened.append(project_to_write())
    return opened[0].database.keep_file(content, name)


def _take(dropped: Dropped[StoredFile], use_videos: UseVideos) -> None:
    """Use what was given; what is wrong with one kind leaves the others."""
    if dropped.of("data set"):
        intake.store_dataset(dropped)
        project = current_project()
        if project is None or not project.holds_recording:
            dropped.use(partial(place_videos, dropped.of("video"), use_videos))
        return
    if not (dropped.photographs or dropped.files):
        return
    project_files = ProjectGiven(project_to_write())
    dropped.use(partial(project_files.add_photographs, dropped.photographs))
    dropped.use(partial(_take_cameras, project_files, dropped))
    dropped.use(partial(_take_tables, project_files, dropped.of("table")))
    cameras = project_files.rig_cameras or CAMERAS
    dropped.use(partial(place_videos, dropped.of("video"), use_videos, cameras, len(cameras)))


def _take_cameras(project_files: ProjectGiven, dropped: Dropped[StoredFile]) -> None:
    """Camera files, those of both cameras or of all, and rigs."""
    files = dropped.of("camera")
    for content in dropped.of("rig").values():
        rig = RigFile.loads(content.decode("utf-8-sig"))
        files |= {f"{camera}.json": write_camera(lens) for camera, lens in rig.cameras.items()}
    several: dict[str, bytes] = {}
    of_two = any(_cameras_of(*table) == 2 for table in dropped.of("table").items())
    for name, content in dropped.of("cameras").items():
        if len(project_files.cameras_in(name, content)) > 2 and not of_two:
            several[name] = content
        else:
            ProjectApplication(project_files.project).ask("archive", name, content)
    if several or len(files) + len(project_files.open_files) > 2:
        project_files.more_cameras({**files, **several})
    elif files:
        # Those whose cameras are known; the others are asked about.
        _use_kept(project_files, project_files.place_cameras(files))


def _use_kept(project_files: ProjectGiven, names: Mapping[CameraName, str]) -> None:
    """Store camera files that were kept as those of their cameras."""
    contents: dict[Slot, tuple[str, bytes]] = {
        camera: (name, project_files.parts[name].read_bytes()) for camera, name in names.items()
    }
    for name in names.values():
        project_files.drop_part(name)
    if contents:
        intake.store_cameras(contents)


def _take_tables(project_files: ProjectGiven, tables: Mapping[str, bytes]) -> None:
    for name, text in with_one_table(tables, ExchangeOptions())[0].items():
        if names_cameras(text, name):
            project_files.more_cameras({name: text})
        elif is_correspondences(text, name):
            intake.store_files({"correspondences": (name, text)})
        elif project_files.is_of_rig and _cameras_of(name, text) > 2:
            project_files.add_parts({name: text})
        else:
            ProjectApplication(project_files.project).ask("bars", name, text)


def _cameras_of(name: str, content: bytes) -> int:
    """How many cameras a table of another program or a person has; 0 if it is none."""
    with suppress(StereocalError):
        if not is_correspondences(text := point_text(content, name), name):
            return len(layout_of(text, name).cameras)
    return 0


def _waiting() -> dict[str, bytes]:
    """The videos given on this page whose cameras are to be asked about."""
    videos: dict[str, bytes] = st.session_state.setdefault(f"{_VIDEOS}_{page_shown()}", {})
    return videos


def place_videos(
    videos: Mapping[str, bytes], use: UseVideos, cameras: tuple[str, ...] = CAMERAS, fewest: int = 2
) -> None:
    """Use videos whose cameras their names tell; others wait for `ask_whose_video`.

    Args:
        fewest: how many are used together.
    """
    if not videos:
        return
    waiting = {**_waiting(), **videos}
    if chapters := chapters_in_words(waiting):
        raise StereocalError(f"{chapters}.")
    if len(waiting) > len(cameras):
        more = "; of more cameras, drop a camera file of each first" * (cameras == CAMERAS)
        raise StereocalError(
            f"{', '.join(waiting)}: these are {len(waiting)} videos. Give those of "
            f"{'two' if cameras == CAMERAS else len(cameras)} cameras{more}."
        )
    _waiting().update(videos)
    known: Mapping[str, str] = which_of(waiting, cameras)
    if cameras == CAMERAS:
        known = which_camera(waiting, one_by_one=True).known
    if len({*known.values()}) == len(waiting) >= fewest:
        named = {camera: name for name, camera in known.items()}
        _use_videos({camera: named[camera] for camera in cameras if camera in named}, use)


def _use_videos(names: Mapping[str, str], use: UseVideos) -> None:
    waiting = _waiting()
    use({camera: (name, waiting.pop(name)) for camera, name in names.items()})


# Questions


def _ask_whose(
    key: str,
    whose: str,
    items: Sequence[Any],
    took: str,
    act: Callable[[Any, Any], object],
    cameras: tuple[str, ...],
    more: Mapping[str, Callable[[], object]],
) -> None:
    """Whose the first of some items is; of two of two cameras, which is the primary's.

    Args:
        whose, took: the questions: of two, and with {} for the first.
        act: called with an item and its camera.
        more: further answers.
    """
    answers: dict[str, Callable[[], object]]
    if len(items) == 2 and cameras == CAMERAS:
        question = f"Which {whose} the primary camera's?"
        answers = {str(item): partial(act, item, CAMERAS[0]) for item in items}
    else:
        question, titles = took.format(items[0]), BOTH if cameras == CAMERAS else cameras
        acts = [partial(act, items[0], camera) for camera in cameras]
        answers = dict(zip(titles, acts, strict=True))
    with st.container(border=True):
        st.markdown(f"**{escape_markdown(question)}**")
        with st.container(horizontal=True):
            for number, (label, answer) in enumerate({**answers, **more}.items()):
                kind = "tertiary" if label == REMOVE else "primary"
                button(escape_markdown(label), f"{key}_{number}", answer, type=kind)


def ask_whose(project_files: ProjectGiven) -> None:
    """Which camera took photographs, and whose a camera file is, one question at a time."""
    if several := project_files.numbered_cameras:
        st.info(
            f"The photographs are of {len(several)} cameras: {', '.join(several)}. To calibrate "
            "all, drop a camera file of each here too; *Lenses* makes one from photographs of a "
            "board. To calibrate two of them, remove the photographs and drop those of two."
        )
        button(REMOVE, "several_cameras", project_files.photographs.clear)
        return
    series = project_files.open_series
    cameras = project_files.rig_cameras if project_files.is_of_rig else CAMERAS
    if series and cameras:
        act = partial(_answer, project_files)
        more_answers: dict[str, Callable[[], object]] = {}
        if cameras == CAMERAS and (split := project_files.split) is not None:
            more_answers[f"Both: {split} in each"] = partial(project_files.divide, split)
        more_answers[REMOVE] = project_files.photographs.clear
        _ask_whose("whose", "photographs are", series, TOOK, act, cameras, more_answers)
    elif files := project_files.open_files:
        more_answers = {"A third camera": partial(project_files.more_cameras, {})}
        if len(files) == 2 or not {*CAMERAS} <= {*project_files.project.inputs.labels}:
            more_answers = {}
        act, took = partial(_give_file, project_files), "Which camera's is {}?"
        _ask_whose("whose_file", "camera file is", files, took, act, CAMERAS, more_answers)


def _answer(project_files: ProjectGiven, series: Series, camera: str) -> None:
    project_files.answer(series, camera)
    if not project_files.is_of_rig and project_files.open_files:  # the photographs may tell now
        _use_kept(project_files, project_files.place_cameras({}))


def _give_file(project_files: ProjectGiven, name: str, camera: CameraName) -> None:
    """Store a camera file as stated, and the other one as the other camera's."""
    (other,) = (side for side in CAMERAS if side != camera)
    names = [name, *(file for file in project_files.open_files if file != name)]
    _use_kept(project_files, dict(zip((camera, other), names, strict=False)))


def ask_whose_video(use: UseVideos, cameras: tuple[str, ...] = CAMERAS, fewest: int = 2) -> None:
    """Which camera took the videos that wait; arguments as of `place_videos`."""
    waiting = [*_waiting()]
    if waiting and fewest > 2:
        st.info(
            f"{escape_markdown(', '.join(waiting))}: give one of each camera, with the camera's "
            f"name in the file's: {escape_markdown(', '.join(cameras))}."
        )
    elif 0 < len(waiting) < fewest:
        words = f"{waiting[0]} waits for the video of the other camera: drop it here."
        both = partial(_use_videos, {CAMERAS[0]: waiting[0]}, use)
        show_with_button("info", words, "It shows both cameras", "video_of_both", both)
    elif waiting:

        def act(name: str, camera: str) -> None:
            """Use a video of a camera; the second of two videos is the other camera's."""
            order = [name, *(video for video in waiting if video != name)]
            both = len(waiting) == 2 and cameras == CAMERAS
            _use_videos(dict(zip(CAMERAS, order, strict=True)) if both else {camera: name}, use)

        _ask_whose("whose_video", "video is", waiting, TOOK, act, cameras, {})
