"""New images on the Check page: a data set, a table, photographs or videos of any cameras."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import PurePosixPath

import streamlit as st

from stereocal.detection.target import Target
from stereocal.errors import StereocalError
from stereocal.formats.camera_file import write_camera
from stereocal.formats.dropped import Dropped
from stereocal.formats.recording_files import pack_recording
from stereocal.frames import several
from stereocal.frames.pairing import Pair
from stereocal.frames.search import STAGES, pack_detection, unpack_detection
from stereocal.intrinsics.files import pack_board, unpack_board
from stereocal.intrinsics.stereo_boards import BOARDS_STAGE, boards_everywhere
from stereocal.matching.point_table import PARQUET
from stereocal.projects.application import IMAGES, ProjectCheck
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.rigid_object import RigidObject
from stereocal.system.records import plain
from stereocal.system.zip_files import pack_zip
from stereocal.ui import jobs
from stereocal.ui.boards import held_board, press_search
from stereocal.ui.door import ask_whose, ask_whose_video, place_videos
from stereocal.ui.drop_zone import drop_zone
from stereocal.ui.fields import Number, one_of, setting
from stereocal.ui.holding import ask_what_is_held, holds_board
from stereocal.ui.messages import callback, readable
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
    """Of the bar that they were calibrated with, if it is known."""
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
        take = partial(_take, seen, use_videos)
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
    try:
        if data_set and (has_points or not given.photographs):
            _use(seen, given.source, pack_zip(given.files))
        elif given.photographs:
            _give_cameras(own, seen.cameras)
            own.add_photographs(given.photographs)
            _as_in_the_data(seen.check.project, own.project)
        elif videos := given.of("video"):
            place_videos(videos, use_videos)
        elif tables:
            name, content = next(iter(tables.items()))
            _use(seen, name, content)
        else:
            given.problems += [f"{name}: this is no new image." for name in given.files]
    except StereocalError as error:
        given.problems.append(str(error))


def _use(seen: Seen, name: str, content: bytes) -> None:
    seen.keep(name, content)
    setting(seen.check.project, "check_images", FILE, one_of([MATCHED, FILE])).set(FILE)


def _give_cameras(own: ProjectGiven, cameras: Mapping[str, Camera]) -> None:
    """Of a rig: which cameras there are, to tell whose photographs are given."""
    if len(cameras) > len(CAMERAS):
        lenses = {f"{name}.json": write_camera(camera) for name, camera in cameras.items()}
        own.recording.add_parts(lenses)


def _moments(seen: Seen) -> several.Moments:
    """The photographs of each moment, by frame and camera."""
    store = seen.photographs
    if tuple(seen.cameras) != CAMERAS:
        return several.match_names(several.by_folder(store.photographs, seen.cameras))
    pairs = [row.pair for row in store.rows if row.use]
    if not pairs:
        raise StereocalError(store.proposal.pairing.sentence)
    return {p.frame: {"primary": p.primary, "secondary": p.secondary} for p in pairs}


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
        moments = readable(lambda: _moments(seen))
        with st.container(horizontal=True, vertical_alignment="center"):
            st.markdown(f"{len(files)} photographs, {len(moments or ())} frames.")
            clear = callback(store.clear)
            st.button("Remove the photographs", key="check_clear", on_click=clear)
        if moments is None:
            return
        pairs = several.pairs_of(moments, *[*next(iter(moments.values()))][:2])
        target, length_m = _held(seen, store, pairs)
        about = {
            "photographs": [
                [k, {c: files[n].name for c, n in own.items()}] for k, own in moments.items()
            ],
            "cameras": {name: camera.to_json() for name, camera in seen.cameras.items()},
            "target": None if target is None else [type(target).__name__, plain(target)],
            "length_m": length_m,
        }
        stages = (BOARDS_STAGE,) if holds_board(project) else STAGES
        work = jobs.Work(
            project,
            "photographs",
            stages,
            about,
            lambda job: target is not None and _find(seen, moments, target, length_m, job),
        )
        found = project.settings.get(FOUND_BY)
        if found is not None and found != work.digest:
            st.warning("The photographs or what is held have changed. Find the targets again.")
        ready = target is not None and length_m is not None
        press_search(work, "targets", "find_new", found is not None, ready)


def _as_in_the_data(whole: Project, project: Project) -> None:
    """Until something else is said, what was held for the calibration is held again."""
    if "held" in project.settings or "held" not in whole.settings:
        return
    same = {name: each for name, each in whole.settings.items() if name.startswith(OF_HELD)}
    project.keep_settings(same)


def _held(
    seen: Seen, store: ProjectPhotographs, pairs: Sequence[Pair]
) -> tuple[Target | BoardPattern | None, float | None]:
    """What is held, and the distance of its targets (m); None until both are stated."""
    project = store.project
    target: Target | BoardPattern | None = ask_what_is_held(store, pairs, fold=True)
    if holds_board(project):
        pattern, entered = held_board(project)
        return pattern, pattern.square_m if pattern is not None and entered else None
    length = setting(project, "length_m", seen.length_m, Number(0.0, or_none=True))
    stated = length.number_input("Distance between targets A and B (m)", format="%.10g")
    return target, stated or None


def _find(
    seen: Seen,
    moments: several.Moments,
    target: Target | BoardPattern,
    length_m: float | None,
    job: jobs.Job,
) -> bool:
    """Find the targets, and use them as the new images."""
    store = seen.photographs
    how = job.executor, job.begin, job.progress, lambda: job.cancelled
    files, cameras = store.photographs, seen.cameras
    if isinstance(target, BoardPattern):
        boards = job.checkpoints("boards", pack_board, unpack_board)
        found = boards_everywhere(moments, files, cameras, target, *how, boards)
        own = None
    else:
        seen_before = job.checkpoints("detections", pack_detection, unpack_detection)
        found = several.find_everywhere(moments, files, cameras, target, *how, seen_before)
        own = RigidObject.bar(length_m or 1.0)
    if found is None:
        return False
    recording = replace(found.recording, object=own or found.recording.object)
    frames = len({*recording.frame.tolist()})
    label = f"targets found in {frames} frames of {len(store.photographs)} photographs"
    recording = replace(recording, name=label)
    seen.keep(label, pack_zip(pack_recording(recording)))
    store.project.keep_settings({FOUND_BY: job.digest})
    return True
