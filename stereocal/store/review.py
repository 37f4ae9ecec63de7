"""The review of a project on disk: the frames, and beside them the edits that can be undone.

`photographs/frames.json` holds the frames as they stand (`project_photographs`),
`photographs/edits.json` what a person did to them (`review.pack_edits`).
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence

from stereocal.errors import DAMAGED, StereocalError
from stereocal.frames.frame import Frame
from stereocal.frames.review import REVIEW_FORMAT, Edit, Review, pack_edits, unpack_edits
from stereocal.store.photographs import ProjectPhotographs
from stereocal.store.state import changing, read_if_there
from stereocal.system.atomic_files import write_atomically

EDITS = "edits.json"


def read_review(store: ProjectPhotographs) -> Review:
    """The frames of a project, and the edits that can be undone.

    Raises:
        StereocalError: the targets have not been found yet, or a file is damaged.
    """
    frames = store.frames
    if frames is None:
        raise StereocalError("The targets have not been found yet.")
    return Review(tuple(frames), _edits(store, frames))


def change_review(store: ProjectPhotographs, change: Callable[[Review], Review]) -> Review:
    """Apply an edit and keep the outcome, which is on disk when this returns.

    Raises:
        StereocalError: the edit is refused, and nothing has changed; or what is left gives the
            project no table of points, and the frames are kept all the same.
    """
    with changing(store.project.folder):
        before = read_review(store)
        after = change(before)
        if after != before:
            # The edits first: one too many only takes back what is so already.
            write_atomically(store.folder / EDITS, pack_edits(after.edits))
            store.keep_frames(after.frames)
        return after


def undo_lost(store: ProjectPhotographs) -> str:
    """Why the edits so far cannot be undone, in a sentence; empty where they can."""
    frames = store.frames
    if frames is None:
        return ""
    try:
        _unpacked(store, frames)
    except StereocalError as error:
        return str(error)
    return ""


def _edits(store: ProjectPhotographs, frames: Sequence[Frame]) -> tuple[Edit, ...]:
    """A list that is damaged costs the undoing alone: the frames stand without it."""
    try:
        return _unpacked(store, frames)
    except StereocalError:
        if _is_of_another_version(store):
            raise
        return ()


def _unpacked(store: ProjectPhotographs, frames: Sequence[Frame]) -> tuple[Edit, ...]:
    content = read_if_there(store.folder / EDITS, "the edits so far cannot be undone")
    return () if content is None else unpack_edits(content, frames)


def _is_of_another_version(store: ProjectPhotographs) -> bool:
    try:
        content = json.loads((store.folder / EDITS).read_bytes())
        return isinstance(content["edits"], list) and content["format"] != REVIEW_FORMAT
    except DAMAGED:
        return False
