"""The review of a project's frames, with edits that can be undone, and their thumbnails, made when
first shown."""

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict

import numpy as np

from stereocal.errors import DAMAGED, StereocalError
from stereocal.frames.frame import CentrePair, frame_from_json
from stereocal.frames.review import Edit, Review
from stereocal.frames.thumbnails import board_tile, side_by_side, tile
from stereocal.intrinsics.boards import BoardView, find_board
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import FloatArray
from stereocal.system.latest import once
from stereocal.system.photograph import GreyImage, read_photograph


def read_review(store: ProjectPhotographs) -> Review:
    """The frames of a project, and the edits that can be undone.

    Edits of a frame that was removed or searched again are left out, and damaged ones.
    """
    with store.database.reading():
        frames = store.frames
        rows = store.database.rows("SELECT json FROM edit ORDER BY number")
    if frames is None:
        raise StereocalError("The targets have not been found yet.")
    edited = {(frame.frame, frame.files) for frame in frames if frame.reviewed or frame.corrected}
    edits: list[Edit] = []
    for (text,) in rows:
        with suppress(*DAMAGED):
            item = json.loads(text)
            before, after = (frame_from_json(item[when]) for when in ("before", "after"))
            edits.append(Edit(before, after, item.get("act")))
    known = [edit for edit in edits if (edit.after.frame, edit.after.files) in edited]
    return Review(tuple(frames), tuple(known))


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


def thumbnail(
    store: ProjectPhotographs,
    names: Sequence[str | None],
    marks: Sequence[CentrePair | FloatArray] = ((None, None), (None, None)),
) -> bytes:
    """A JPEG of two photographs; grey where there is none.

    Args:
        marks: of each, its targets, about which it is cut out; or the corners (n, 2) px of a board
            or markers, on the whole photograph.
    """
    photographs = store.photographs
    files = [photographs.get(name) if name else None for name in names]

    def make() -> bytes:
        first, second = (
            board_tile(_image(file), mark)
            if isinstance(mark, np.ndarray)
            else tile(_image(file), mark)
            for file, mark in zip(files, marks, strict=True)
        )
        return side_by_side(first, second)

    plain_marks = [mark.tolist() if isinstance(mark, np.ndarray) else mark for mark in marks]
    return once("thumbnail", repr(([file and file.name for file in files], plain_marks)), make)


def board_corners(file: StoredFile, pattern: BoardPattern) -> FloatArray:
    """(n, 2): the corners of the board in a photograph; none if it shows none."""

    def find() -> FloatArray:
        image = _image(file)
        board = None if image is None else find_board(image, pattern, "")
        return board.corners if isinstance(board, BoardView) else np.empty((0, 2))

    return once("board in a photograph", repr((file.name, pattern)), find)


def _image(file: StoredFile | None) -> GreyImage | None:
    try:
        return read_photograph(file) if file else None
    except StereocalError:
        return None
