"""New images on the Check page: a data set, a table, photographs or videos of any cameras."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePosixPath

import streamlit as st

from stereocal.formats.dropped import Dropped
from stereocal.formats.recording_files import pack_recording
from stereocal.frames import all_cameras
from stereocal.matching.point_table import PARQUET
from stereocal.projects.application import IMAGES, ProjectCheck
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import Camera
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.numbers import count
from stereocal.system.zip_files import pack_zip
from stereocal.ui.all_cameras import ask_held, moment_search
from stereocal.ui.door import ask_whose, ask_whose_video, place_videos
from stereocal.ui.fields import Number, one_of, setting
from stereocal.ui.holding import holds_board
from stereocal.ui.intake import drop_zone
from stereocal.ui.messages import button, readable
from stereocal.ui.photographs import press_search
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import show_frames_taken, take_videos, video_settings

MATCHED, FILE = "The pairs of Apply", "A file"
CAN_BE_GIVEN = """
- **Photographs** of the bar or the board by all cameras, or a **video** of each of two.
- A **data set**: a zip or a folder with `dataset.json`.
- A **table** of bars like `{}`, or of matched points of two cameras alone, like `pairs.csv` of
  Apply.

Five bars or 50 points are a good start.
"""
FOUND_BY = "check_found_by"
OF_HELD = ("held", "board_")
"""What the names of settings begin with that say what is held."""
Given = tuple[str, bytes]


@dataclass(frozen=True, eq=False)
class Seen:
    """Who takes new images."""

    check: ProjectCheck
    cameras: Mapping[str, Camera]
    length_m: float | None
    """The bar that they were calibrated with, if it is known."""
    keep: Callable[[str, bytes], object]
    """Checks and stores a file."""
    table: str
    """Name of a table of bars."""
    title: str
    """What can be given."""

    @property
    def photographs(self) -> ProjectPhotographs:
        """The new photographs."""
        return ProjectPhotographs(self.check.of_images)


def new_images(seen: Seen, matched: Given | None = None) -> Given | None:
    """The place for new images, and the name and content of those in use; None if there are none.

    Args:
        matched: pairs of Apply, which serve too.
    """
    project, given = seen.check.project, seen.check.file(IMAGES)
    kinds = [*([MATCHED] if matched else []), *([FILE] if given else [])]
    usual = FILE if given else MATCHED
    kind = setting(project, "check_images", usual, one_of(kinds or [FILE]))
    zone, whose = st.container(), st.container()
    with st.expander("What can I give?"):
        st.markdown(CAN_BE_GIVEN.format(seen.table))
        own = seen.photographs.project
        use_videos = partial(take_videos, settings=video_settings(own), project=own)
    with zone:

        def take(given: Dropped[StoredFile]) -> None:
            given.use(partial(_take, seen, use_videos, given))

        drop_zone(seen.title, "upload_check_images", seen.photographs.keep, take, tables=PARQUET)
    with whose:
        ask_whose(ProjectGiven(own))
        ask_whose_video(use_videos)
        show_frames_taken(own)
        _search(seen)
    if len(kinds) > 1:
        kind.menu("Check")
    if matched is not None and kind.value() == MATCHED:
        st.caption(f"In use: {escape_markdown(matched[0])}")
        return matched
    if given is None:
        return None
    st.caption(f"In use: {escape_markdown(given.label)}")
    return given.label, given.read_bytes()


def _take(seen: Seen, use_videos: Callable[..., None], given: Dropped[StoredFile]) -> None:
    """Use what was given: photographs and videos to be searched, or a file as it is."""
    own = ProjectGiven(seen.photographs.project)
    tables, data_set = given.of("table"), bool(given.of("data set"))
    has_points = any(PurePosixPath(name).suffix.lower() == ".csv" for name in given.files)
    if data_set and (has_points or not given.photographs):
        _use(seen, given.source, pack_zip(given.files))
    elif given.photographs:
        own.name_cameras(seen.cameras)
        own.add_photographs(given.photographs)
        _as_in_the_data(seen.check.project, own.project)
    elif videos := given.of("video"):
        place_videos(videos, use_videos)
    elif tables:
        name, content = next(iter(tables.items()))
        _use(seen, name, content)
    else:
        given.problems += [f"{name}: this is no new image." for name in given.files]


def _use(seen: Seen, name: str, content: bytes) -> None:
    seen.keep(name, content)
    setting(seen.check.project, "check_images", FILE, one_of([MATCHED, FILE])).set(FILE)


def _search(seen: Seen) -> None:
    """What is held in the new photographs, and the press that looks for it."""
    store = seen.photographs
    project, files = store.project, readable(lambda: store.photographs) or {}
    if not files:
        return
    if not seen.cameras:
        st.info("The photographs are searched once there are parameters, which have the lenses.")
        return
    with st.container(border=True):
        moments = readable(lambda: store.moments([*seen.cameras]))
        with st.container(horizontal=True, vertical_alignment="center"):
            st.markdown(f"{count(len(files), 'photograph')}, {count(len(moments or ()), 'frame')}.")
            button("Remove the photographs", "check_clear", store.clear)
        if moments is None:
            return
        held, ready = ask_held(store, moments, fold=True)
        length_m = None
        if not holds_board(project):
            length = setting(project, "length_m", seen.length_m, Number(0.0, or_none=True))
            label = "Distance between targets A and B (m)"
            length_m = length.number_input(label, format="%.10g") or None
            ready = ready and length_m is not None
        keep = partial(_keep, seen, length_m)
        work = moment_search(store, seen.cameras, moments, held, keep, length_m=length_m)
        found = project.settings.get(FOUND_BY)
        if found is not None and found != work.digest:
            st.warning("The photographs or what is held have changed. Find the targets again.")
        press_search(work, "targets", "find_new", found is not None, ready)


def _as_in_the_data(whole: Project, project: Project) -> None:
    """Until something else is said, what was held for the calibration is held again."""
    if "held" in project.settings or "held" not in whole.settings:
        return
    same = {name: each for name, each in whole.settings.items() if name.startswith(OF_HELD)}
    project.keep_settings(same)


def _keep(
    seen: Seen, length_m: float | None, found: all_cameras.FoundRecording, digest: str
) -> None:
    """Use the targets that were found as the new images."""
    store, recording = seen.photographs, found.recording
    frames = len({*recording.frame.tolist()})
    label = f"targets found in {frames} frames of {len(store.photographs)} photographs"
    own = recording.object if length_m is None else RigidObject.bar(length_m)
    recording = replace(recording, object=own, name=label)
    seen.keep(label, pack_zip(pack_recording(recording)))
    store.project.keep_settings({FOUND_BY: digest})
