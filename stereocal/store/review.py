"""The review of a project on disk: the frames, and beside them the edits that can be undone.

`photographs/frames.json` holds the frames as they stand (`project_photographs`),
`photographs/edits.json` what a person did to them (`review.pack_edits`).
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from stereocal.errors import StereocalError
from stereocal.frames.review import Review, pack_edits, unpack_edits
from stereocal.store.photographs import ProjectPhotographs
from stereocal.writing import write_atomically

_CHANGING = threading.Lock()
"""One edit at a time in this server; an edit reads, changes and replaces."""


def read_review(store: ProjectPhotographs) -> Review:
    """The frames of a project, and the edits that can be undone.

    Raises:
        StereocalError: the targets have not been found yet, or a file is damaged.
    """
    frames = store.frames
    if frames is None:
        raise StereocalError("The targets have not been found yet.")
    path = store.folder / "edits.json"
    return Review(tuple(frames), unpack_edits(path.read_bytes(), frames) if path.is_file() else ())


def change_review(store: ProjectPhotographs, change: Callable[[Review], Review]) -> Review:
    """Apply an edit and keep the outcome, which is on disk when this returns.

    Raises:
        StereocalError: the edit is refused, and nothing has changed; or what is left gives the
            project no table of points, and the frames are kept all the same.
    """
    with _CHANGING:
        before = read_review(store)
        after = change(before)
        if after != before:
            # The edits first: one too many only takes back what is so already.
            write_atomically(store.folder / "edits.json", pack_edits(after.edits))
            store.keep_frames(after.frames)
        return after
