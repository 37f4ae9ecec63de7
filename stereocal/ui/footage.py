"""The pictures in which points are clicked: videos or photographs given for it, which are stored
nowhere, else the project's own photographs."""

import filecmp
import shutil
import tempfile
import weakref
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path, PurePosixPath

import streamlit as st

from stereocal.errors import StereocalError, disk_errors
from stereocal.formats.dropped import AGAIN
from stereocal.frames.pairing import natural
from stereocal.frames.proposal import Choice, propose
from stereocal.frames.video.decoding import SUFFIXES
from stereocal.frames.video.footage import Footage, of_photographs, of_videos
from stereocal.frames.which_camera import which_camera
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.projects.project import Project
from stereocal.rig.camera import CAMERAS, CameraName
from stereocal.system.latest import Latest
from stereocal.system.photograph import PhotographFile
from stereocal.system.taken import read_taken
from stereocal.ui.fields import Number, setting
from stereocal.ui.intake import Upload, emptied_uploader
from stereocal.ui.messages import ErrorsShown, callback, readable
from stereocal.ui.texts import escape_markdown
from stereocal.ui.videos import MISSING


class _Files(dict[str, Path]):
    """Files in a temporary folder, by their names; removed when nothing uses them any more."""

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="stereocal-footage-"))
        weakref.finalize(self, shutil.rmtree, self.folder, True)


@dataclass(eq=False)
class _Given:
    """The files, and the pictures in them."""

    files: _Files
    exchanged: bool
    later_frames: int
    footage: Footage


_GIVEN: Latest[_Given] = Latest(8)
"""By project, as long as the server runs."""
_OWN: Latest[Footage] = Latest(4)


def footage_of(project: Project) -> Footage | None:
    """What was given here, else the project's own photographs, if there are any."""
    given = _GIVEN.get(_key(project))
    return given.footage if given else readable(partial(_own, project), told=False)


def ask_footage(project: Project, footage: Footage | None, usual_later: int) -> None:
    """The uploader, which cameras the pictures are of, and when they began.

    Args:
        usual_later: by how many frames the secondary's video began later, if nothing is stated.
    """
    used, given = "none yet", _GIVEN.get(_key(project))
    if footage is not None:
        labels = escape_markdown(", ".join(footage.labels[camera] for camera in CAMERAS))
        used = f"{labels}, {len(footage.numbers)} frames"
    with st.expander(f"Pictures: {used}", expanded=footage is None):
        label, above = "Videos or photographs of both cameras, together", st.container()
        field = setting(project, "clicks_later_frames", usual_later, Number(-10_000_000))
        title = "The secondary's video was started later by (frames)"
        later = field.number_input(title, help="For cameras that were started by hand.")
        with above:
            emptied_uploader(label, None, "upload_footage", partial(_take, project, later))
        if given is None:
            return
        if given.later_frames != later:
            with ErrorsShown():
                _open(project, given.files, given.exchanged, later)
                st.rerun()
        exchange = partial(_open, project, given.files, not given.exchanged, later)
        label = "Exchange the cameras"
        st.button(label, "clicks_exchange", on_click=callback(exchange))


def _key(project: Project) -> str:
    return f"{project.id} {project.database.scope}"


def _own(project: Project) -> Footage | None:
    store = ProjectPhotographs(project)
    files, pairs = store.photographs, [row.pair for row in store.rows if row.use]
    found: dict[int, dict[CameraName, PhotographFile]] = {
        pair.frame: {"primary": files[pair.primary], "secondary": files[pair.secondary]}
        for pair in pairs
        if {pair.primary, pair.secondary} <= {*files}
    }
    labels = {camera: f"the {camera} photographs of this project" for camera in CAMERAS}
    key = f"{_key(project)} {[(each, files[each.primary].name) for each in pairs]}"
    return _OWN.once(key, lambda: of_photographs(found, labels)) if found else None


def _take(project: Project, later: int, uploads: Sequence[Upload]) -> None:
    with disk_errors("The files cannot be stored"):
        files = _Files()
        for number, upload in enumerate(uploads):
            path = files.folder / f"{number}{PurePosixPath(upload.name).suffix.lower()}"
            path.write_bytes(upload.getvalue())
            # Both cameras may give their files the same names.
            files[f"{AGAIN}/{upload.name}" if upload.name in files else upload.name] = path
    _open(project, files, False, later)


def _open(project: Project, files: _Files, exchanged: bool, later: int) -> None:
    """Read what can be known of the files without decoding them, and use them."""
    videos = sorted((name for name in files if files[name].suffix in SUFFIXES), key=natural)
    if not videos:
        footage = _photographs(files, exchanged)
    elif len(videos) != 2 or len(files) != 2:
        raise StereocalError("Give the videos of both cameras together, and nothing else.")
    elif find_spec("av") is None:
        raise StereocalError(MISSING)
    else:
        sides = {side: name for name, side in which_camera(videos, each=True).known.items()}
        names = videos if len(sides) < 2 else [sides[camera] for camera in CAMERAS]
        labels = dict(zip(CAMERAS, names[::-1] if exchanged else names, strict=True))
        paths = {camera: files[name] for camera, name in labels.items()}
        footage = _videos(paths, labels, later)
    _GIVEN.keep(_key(project), _Given(files, exchanged, later, footage))


def _videos(
    paths: Mapping[CameraName, Path], labels: Mapping[CameraName, str], later: int
) -> Footage:
    first, second = (paths[camera] for camera in CAMERAS)
    if filecmp.cmp(first, second, shallow=False):
        raise StereocalError(
            "Both files are the same video: give the videos of both cameras together."
        )
    try:
        return of_videos(paths, labels, later)
    except StereocalError as error:
        stored, _, told = str(error).partition(": ")
        names = {path.name: labels[camera] for camera, path in paths.items()}
        if stored not in names:
            raise
        raise StereocalError(f"{names[stored]}: {told}") from error


def _photographs(files: Mapping[str, Path], exchanged: bool) -> Footage:
    taken = {name: read_taken(path, name) for name, path in files.items()}
    pairs = propose(taken, Choice(exchanged=exchanged)).pairing.pairs
    if not pairs:
        raise StereocalError(
            "These files are not the photographs of two cameras, or it cannot be told which belong "
            "together: give them as left1.png and right1.png, or two videos."
        )
    found: dict[int, dict[CameraName, PhotographFile]] = {
        pair.frame: {"primary": files[pair.primary], "secondary": files[pair.secondary]}
        for pair in pairs
    }
    first = pairs[0]
    return of_photographs(found, {"primary": first.primary, "secondary": first.secondary})
