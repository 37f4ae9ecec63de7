"""Videos on the pages: their frames become photographs of the project."""

import re
import shutil
import tempfile
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from dataclasses import replace
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
from stereocal.ui import jobs
from stereocal.ui.fields import Number, choose_from_menu, setting, yes_or_no
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
MISSING = (
    "To read videos, stereocal needs the package av. Stop stereocal, run "
    '`pip install "stereocal[video]"`, and start it again.'
)


def show_frames_taken(project: Project) -> None:
    """The progress of the job that takes frames, and what it found."""
    jobs.show_job(project, "video", "Cancelled. No frame was taken.")
    sentences = project.settings.get(REPORT)
    if isinstance(sentences, list) and not jobs.is_running(project, "video"):
        show = st.warning if project.settings.get(FRAMES_MISSING) else st.success
        show(" ".join(escape_markdown(str(sentence)) for sentence in sentences))


def video_settings(project: Project | None) -> VideoSettings:
    """Which frames to take; the defaults serve most videos."""

    def toggle(place: DeltaGenerator, name: str, title: str, text: str, on: bool = True) -> bool:
        field = setting(project, f"video_{name}", on, yes_or_no)
        return place.toggle(title, help=text, **field.widget())

    left, right = st.columns(2, vertical_alignment="bottom")
    key, title, named = "video_choice", "Which frames of the videos", CHOICES.__getitem__
    choice = choose_from_menu(project, key, title, CHOICES, place=left, format_func=named)
    n = 30
    if choice == "every":
        n = setting(project, "video_n", 30, Number(1)).number_input("n", right)
    left, right = st.columns(2, vertical_alignment="bottom")
    clocks = "Otherwise their time stamps are compared as the cameras' clocks wrote them."
    later, hint = None, "Then the motion of what you hold tells by how much, to a frame."
    by_hand = toggle(st.container(), "by_hand", "The cameras were started by hand", hint, on=False)
    together = "Both videos start at the same moment"
    if not by_hand and not toggle(left, "together", together, clocks):
        ahead = setting(project, "video_later_s", 0.0, Number(-1e12))
        title = "The secondary's clock is ahead by (s)"
        later = ahead.number_input(title, right, format="%.6g")
    grey = "Balls are told apart by them. Without, the frames are grey, a third of the size."
    coloured = toggle(st.container(), "coloured", "Keep the colours of videos", grey)
    return VideoSettings(choice, n, later, by_hand, coloured)


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
    project.keep_settings({REPORT: None})
    start_taking(project, "video", videos, partial(_take, project, settings))


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
    if find_spec("av") is None:
        raise StereocalError(MISSING)
    if jobs.is_running(project, kind):
        raise StereocalError("Something else is running here: wait, or cancel it.")
    with ExitStack() as undo, disk_errors("The videos cannot be stored"):
        folder = Path(tempfile.mkdtemp(prefix="stereocal-video-"))
        undo.callback(shutil.rmtree, folder, ignore_errors=True)
        paths = {}
        for which, (name, content) in videos.items():
            # Messages name the file, and its name is not trusted.
            paths[which] = folder / which / UNSAFE.sub("_", PurePosixPath(name).name)
            paths[which].parent.mkdir()
            paths[which].write_bytes(content)

        def run(job: jobs.Job) -> None:
            try:
                take(paths, job)
            finally:
                shutil.rmtree(folder, ignore_errors=True)

        job = jobs.start(jobs.PageWork(project, kind, STAGES, run))
        if job.state != "failed":  # else it may not have been started
            undo.pop_all()


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
        store.clear(others)
    store.add(photographs)
    if settings.by_hand:
        store.choose(Choice("motion", heard=report.heard))
    project.keep_settings({REPORT: list(report.sentences), FRAMES_MISSING: report.frames_missing})
