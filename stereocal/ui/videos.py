"""Videos on the pages: their frames become photographs of the project."""

import re
import shutil
import tempfile
import weakref
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path, PurePosixPath

import streamlit as st
from streamlit.delta_generator import DeltaGenerator

from stereocal.errors import StereocalError, disk_errors
from stereocal.frames.proposal import Choice
from stereocal.frames.video.extract import STAGES, FrameChoice, VideoSettings, extract
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.system.latest import Latest
from stereocal.ui import jobs
from stereocal.ui.fields import Field, Number, choose_from_menu, one_of, setting, yes_or_no
from stereocal.ui.messages import show_with_button
from stereocal.ui.project import project_to_write
from stereocal.ui.texts import escape_markdown

CHOICES: dict[FrameChoice, str] = {
    "still": "The sharpest still frame of each second; of short videos 30",
    "every": "Every n-th frame",
}
TakeFrames = Callable[[Mapping[str, Path], jobs.Job], None]
"""Takes frames of the videos of each camera, as a job."""
UNSAFE = re.compile(r"[^\w .-]")
"""Signs that a file's name may not have."""
FRAME = re.compile(r"[^/]+/\d{6}\.(?:png|jpg)")
REPORT = "video_report"
FRAMES_MISSING = "video_frames_missing"
APART = "video_apart"
STARTED = {False: "started together", True: "started by hand"}
"""Whether the cameras were started by hand, in words."""
AGAIN = "Give both videos again: other frames of them are taken."
MISSING = (
    "To read videos, stereocal needs the package av. Stop stereocal, run "
    '`pip install "stereocal[video]"`, and start it again.'
)


class _Folder:
    """A folder of videos, which is removed when nothing uses them any more."""

    def __init__(self) -> None:
        self.path = Path(tempfile.mkdtemp(prefix="stereocal-video-"))
        weakref.finalize(self, shutil.rmtree, self.path, True)


@dataclass(frozen=True)
class _Taken:
    """The videos of the frames that were taken last, to take others."""

    folder: _Folder
    paths: Mapping[str, Path]
    settings: VideoSettings


_TAKEN: Latest[_Taken] = Latest(4)
"""Of each project, and so no result that is made again: while the server runs."""


def show_frames_taken(project: Project) -> None:
    """The progress of the job that takes frames, whether the cameras were in step, and what it
    found."""
    taken, settings = _TAKEN.get(_key(project)), project.settings
    of_two, sentences = taken is None or len(taken.paths) == 2, settings.get(REPORT)
    given = sentences or jobs.is_running(project, "video")
    if given and of_two and not ProjectPhotographs(project).found_in:
        _by_hand(project).buttons("The cameras were", format_func=STARTED.__getitem__)
    jobs.show_job(project, "video", "Cancelled. No frame was taken.")
    if isinstance(sentences, list) and not jobs.is_running(project, "video"):
        show = st.warning if settings.get(FRAMES_MISSING) else st.success
        doubt = settings.get(APART) or ""
        show(" ".join(escape_markdown(str(each)) for each in sentences if each != doubt))
        if doubt:
            act, label = _by_hand(project).set, STARTED[True].capitalize()
            show_with_button("warning", str(doubt), label, "videos_by_hand", act, True, first=True)


def _key(project: Project) -> str:
    return f"{project.id} {project.database.scope}"


def _by_hand(project: Project) -> Field:
    """Whether the cameras were started by hand; another answer takes other frames."""
    stored = setting(project, "video_by_hand", False, one_of(STARTED))

    def write(by_hand: bool) -> None:
        stored.write(by_hand)
        if (taken := _TAKEN.get(_key(project))) is not None:
            _begin(project, replace(taken, settings=replace(taken.settings, by_hand=by_hand)))
        else:
            project.keep_settings({REPORT: [AGAIN], FRAMES_MISSING: True, APART: None})

    return replace(stored, write=write)


def video_settings(project: Project | None) -> VideoSettings:
    """Which frames to take; the defaults serve most videos."""

    def toggle(place: DeltaGenerator, name: str, title: str, text: str) -> bool:
        field = setting(project, f"video_{name}", True, yes_or_no)
        return place.toggle(title, help=text, **field.widget())

    left, right = st.columns(2, vertical_alignment="bottom")
    key, title, named = "video_choice", "Which frames of the videos", CHOICES.__getitem__
    choice = choose_from_menu(project, key, title, CHOICES, place=left, format_func=named)
    n = 30
    if choice == "every":
        n = setting(project, "video_n", 30, Number(1)).number_input("n", right)
    left, right = st.columns(2, vertical_alignment="bottom")
    clocks = "Otherwise their time stamps are compared as the cameras' clocks wrote them."
    later = None
    if not toggle(left, "together", "Both videos start at the same moment", clocks):
        ahead = setting(project, "video_later_s", 0.0, Number(-1e12))
        title = "The secondary's clock is ahead by (s)"
        later = ahead.number_input(title, right, format="%.6g")
    grey = "Balls are told apart by them. Without, the frames are grey, a third of the size."
    coloured = toggle(st.container(), "coloured", "Keep the colours of videos", grey)
    by_hand = setting(project, "video_by_hand", False, one_of(STARTED))
    return VideoSettings(choice, n, later, by_hand.value(), coloured)


def take_videos(
    videos: Mapping[str, tuple[str, bytes]], settings: VideoSettings, project: Project | None = None
) -> None:
    """Begin the job; the videos are temporary files while it runs.

    Args:
        videos: name and content by camera; of one camera alone, it shows both.
        project: whose photographs the frames become; None: the current one, or a new one.

    Raises:
        StereocalError: they cannot be read on this server, or not be stored.
    """
    project = project or project_to_write()
    if len(videos) == 1:
        settings = replace(settings, split="by shape")
    # Of three cameras and more, the motion alone tells which frames belong together.
    settings = replace(settings, by_hand=settings.by_hand or len(videos) > 2)
    folder, paths = _stored(project, "video", videos)
    _begin(project, _Taken(folder, paths, settings))


def _begin(project: Project, taken: _Taken) -> None:
    """Begin to take frames, in the place of those that are being taken."""
    _TAKEN.keep(_key(project), taken)
    project.keep_settings({REPORT: None, APART: None})
    take = partial(_take, project, taken.settings, taken.paths)
    jobs.start(jobs.PageWork(project, "video", STAGES, take), anew=True)


def start_taking(
    project: Project, kind: jobs.Kind, videos: Mapping[str, tuple[str, bytes]], take: TakeFrames
) -> None:
    """Begin a job with videos, which are temporary files while it runs.

    Args:
        kind: of the job; no other one of its kind may run.
        videos: as of `take_videos`.

    Raises:
        StereocalError: as of `take_videos`.
    """
    folder, paths = _stored(project, kind, videos)

    def run(job: jobs.Job) -> None:
        take(paths, job)
        shutil.rmtree(folder.path, ignore_errors=True)

    jobs.start(jobs.PageWork(project, kind, STAGES, run))


def _stored(
    project: Project, kind: jobs.Kind, videos: Mapping[str, tuple[str, bytes]]
) -> tuple[_Folder, dict[str, Path]]:
    """A folder with videos, and their paths by camera, if videos can be read now."""
    if find_spec("av") is None:
        raise StereocalError(MISSING)
    if jobs.is_running(project, kind):
        raise StereocalError("Something else is running here: wait, or cancel it.")
    with disk_errors("The videos cannot be stored"):
        folder, paths = _Folder(), dict[str, Path]()
        for which, (name, content) in videos.items():
            # Messages name the file, and its name is not trusted.
            paths[which] = folder.path / which / UNSAFE.sub("_", PurePosixPath(name).name)
            paths[which].parent.mkdir()
            paths[which].write_bytes(content)
    return folder, paths


def _take(
    project: Project, settings: VideoSettings, videos: Mapping[str, Path], job: jobs.Job
) -> None:
    store = ProjectPhotographs(project)
    photographs: dict[str, StoredFile] = {}

    def keep(name: str, content: bytes) -> None:
        photographs[name] = store.keep(name, content)

    report = extract(videos, settings, keep, job.begin, job.progress)
    if settings.by_hand != (store.choice.way == "motion"):
        # The numbers of frames that were taken before are of other moments.
        others = {n: f for n, f in store.photographs.items() if not FRAME.fullmatch(n)}
        store.clear({**others, **photographs})  # some may be those of before
    store.add(photographs)
    if settings.by_hand:
        store.choose(Choice("motion", heard=report.heard))
    missing = report.frames_missing
    told = {REPORT: list(report.sentences), FRAMES_MISSING: missing, APART: report.apart}
    project.keep_settings(told)
