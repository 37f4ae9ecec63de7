"""The review of a project's frames, with edits that can be undone."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict

from stereocal.errors import DAMAGED, StereocalError
from stereocal.frames.frame import Frame, frame_from_json
from stereocal.frames.review import Edit, Review
from stereocal.projects.photographs import ProjectPhotographs


def read_review(store: ProjectPhotographs) -> Review:
    """The frames of a project, and the edits that can be undone.

    Edits of a frame that was removed or searched again are left out, and damaged ones.
    """
    with store.database.reading():
        frames = store.frames
        rows = store.database.rows("SELECT json FROM edit ORDER BY number")
    if frames is None:
        raise StereocalError("The targets have not been found yet.")
    there = {(frame.frame, frame.files) for frame in frames if frame.reviewed or frame.corrected}
    edits = [edit for (text,) in rows if (edit := _edit(text)) is not None]
    return Review(
        tuple(frames),
        tuple(edit for edit in edits if (edit.after.frame, edit.after.files) in there),
    )


def change_review(store: ProjectPhotographs, change: Callable[[Review], Review]) -> Review:
    """Apply an edit and store the outcome.

    Raises:
        StereocalError: the edit is refused, and nothing has changed; or the frames are stored, but
            give no valid table of points.
    """
    refused = None
    with store.database.transaction() as db:
        before = read_review(store)
        after = change(before)
        if after != before:
            same = sum(a == b for a, b in zip(before.edits, after.edits, strict=False))
            for _ in before.edits[same:]:
                db.execute("DELETE FROM edit WHERE number = (SELECT max(number) FROM edit)")
            rows = [(json.dumps(asdict(edit), allow_nan=False),) for edit in after.edits[same:]]
            db.executemany("INSERT INTO edit (json) VALUES (?)", rows)
            refused = store.keep_corrected(after.frames)
    if refused is not None:
        raise refused
    return after


def _edit(text: str) -> Edit | None:
    try:
        item = json.loads(text)
        frames: list[Frame] = [frame_from_json(item[when]) for when in ("before", "after")]
        return Edit(*frames)
    except DAMAGED:
        return None
