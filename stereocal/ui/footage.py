"""The pictures in which points are clicked: videos, which the server has while it runs,
photographs, which the project keeps, or those that it was calibrated with."""

import filecmp
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path, PurePosixPath

import streamlit as st

from stereocal.errors import StereocalError, disk_errors
from stereocal.fit.rig_file import Parameters
from stereocal.formats.dropped import Dropped
from stereocal.frames.video.footage import Footage, of_photographs, of_videos
from stereocal.projects.clicks import ProjectClicks
from stereocal.projects.files import StoredFile
from stereocal.projects.given import ProjectGiven
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import camera_in_words
from stereocal.system.latest import Latest, once
from stereocal.ui.door import ask_whose, ask_whose_video, place_videos
from stereocal.ui.fields import Number, setting
from stereocal.ui.intake import drop_zone
from stereocal.ui.messages import button, readable
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import MISSING

TITLE = "Videos or photographs of the cameras, together or one after the other"
KEPT = (
    "Photographs are kept with the project. Videos are not: give them again once the server was "
    "started again. What you click is stored at once."
)


class _Videos:
    """Videos by camera, in folders that are removed when nothing uses them any more."""

    def __init__(self) -> None:
        self.paths: dict[str, Path] = {}
        self.opened: Latest[Footage] = Latest(2)

    def take(self, videos: Mapping[str, tuple[str, bytes]], cameras: Sequence[str]) -> None:
        """Add videos, or replace those of the same cameras, if they can be read with the others.

        Args:
            cameras: in whose order they are kept.
        """
        if find_spec("av") is None:
            raise StereocalError(MISSING)
        paths = dict(self.paths)
        with disk_errors("The videos cannot be stored"):
            for camera, (name, content) in videos.items():
                folder = tempfile.mkdtemp(prefix="stereocal-footage-")
                weakref.finalize(self, shutil.rmtree, folder, True)
                path = Path(folder) / PurePosixPath(name).name
                path.write_bytes(content)
                for other, other_path in paths.items():
                    if other != camera and filecmp.cmp(path, other_path, shallow=False):
                        whose = f"{camera_in_words(camera)} and of {camera_in_words(other)}"
                        raise StereocalError(f"{name}: the same video is given of {whose}.")
                paths[camera] = path
        paths = {camera: paths[camera] for camera in cameras if camera in paths}
        if len(paths) > 1:
            of_videos(paths, _names(paths))
        self.paths = paths

    def footage(self, later: Mapping[str, int]) -> Footage:
        """The frames of all videos."""
        labels, first_camera = _names(self.paths), next(iter(self.paths))
        later = {camera: frames - later.get(first_camera, 0) for camera, frames in later.items()}
        make = partial(of_videos, self.paths, labels, later)
        return self.opened.once(repr((labels, later)), make)


_VIDEOS: Latest[_Videos] = Latest(8)
"""What was given to each project, and so no result that is made again."""


class Pictures:
    """The pictures of a project's cameras, and the place to give them."""

    def __init__(self, project: Project, rig: Parameters) -> None:
        self.project, self.rig, self.cameras = project, rig, tuple(rig.placed)
        self.given = ProjectGiven(ProjectClicks(project).of_pictures)
        first, *others = self.cameras
        self.later = {}
        for camera in others:
            pair = rig.pair(first, camera)
            key, usual = f"clicks_later_{camera}", pair.start_frame
            self.later[camera] = setting(project, key, usual, Number(-10_000_000))

    @property
    def _key(self) -> str:
        return f"{self.project.id} {self.project.database.scope}"

    def show(self) -> Footage | None:
        """What was given here, else the project's own photographs; and the place for others."""
        videos = _VIDEOS.get(self._key) or _Videos()
        footage = readable(partial(self._footage, videos))
        used = "none yet"
        if footage is not None:
            used = f"{', '.join(footage.labels.values())}, {len(footage.numbers)} frames"
        asks = footage is None or bool(self.given.open_series)
        with st.expander(f"Pictures: {escape_markdown(used)}", expanded=asks):
            drop_zone(TITLE, "upload_footage", self.given.photographs.keep, self._take)
            ask_whose(self.given)
            ask_whose_video(self._use, self.cameras, 1)
            if len(videos.paths) == 1:
                ((camera, path),) = videos.paths.items()
                named = escape_markdown(f"{path.name} is that of {camera_in_words(camera)}")
                st.info(f"{named}: give the video of another one too.")
            elif videos.paths:
                for camera, field in self.later.items():
                    title = f"Frames by which the video of {camera_in_words(camera)} began later"
                    field.number_input(escape_markdown(title), help="If started by hand.")
            if videos.paths or self.given.photographs.photographs:
                button("Remove these pictures", "clicks_clear", self._clear)
            st.caption(KEPT)
        return footage

    def _footage(self, videos: _Videos) -> Footage | None:
        if videos.paths:
            later = {camera: field.value() for camera, field in self.later.items()}
            return videos.footage(later) if len(videos.paths) > 1 else None
        for project, whose in ((self.given.project, ""), (self.project, " of this project")):
            store = ProjectPhotographs(project)
            if not (files := store.photographs):
                continue
            with suppress(*([StereocalError] if whose else [])):
                moments = store.paired(self.cameras).moments
                frames = {
                    frame: {camera: files[name] for camera, name in names.items() if name in files}
                    for frame, names in moments.items()
                }
                seen = {camera for pictures in frames.values() for camera in pictures}
                labels = {c: f"{c} photographs{whose}" for c in self.cameras if c in seen}
                make = partial(of_photographs, frames, labels)
                return once("footage of photographs", f"{self._key} {frames}", make)
        return None

    def _take(self, dropped: Dropped[StoredFile]) -> None:
        self.given.name_cameras({name: placed.camera for name, placed in self.rig.placed.items()})
        dropped.use(partial(self.given.add_photographs, dropped.photographs))
        dropped.use(partial(place_videos, dropped.of("video"), self._use, self.cameras, 1))

    def _use(self, videos: Mapping[str, tuple[str, bytes]]) -> None:
        stored = _VIDEOS.get(self._key) or _Videos()
        stored.take(videos, self.cameras)
        _VIDEOS.keep(self._key, stored)

    def _clear(self) -> None:
        _VIDEOS.keep(self._key, _Videos())
        self.given.photographs.clear()
        self.given.name_cameras({})


def _names(paths: Mapping[str, Path]) -> dict[str, str]:
    return {camera: path.name for camera, path in paths.items()}
