"""The review of a project's frames, with edits that can be undone, and their thumbnails, made when
first shown."""

import json
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict
from functools import lru_cache

import numpy as np

from stereocal.errors import DAMAGED, StereocalError
from stereocal.frames.frame import Centre, CentrePair, Frame, frame_from_json
from stereocal.frames.pairing import Pair
from stereocal.frames.review import Edit, Review
from stereocal.frames.thumbnails import board_tile, side_by_side, tile
from stereocal.intrinsics.boards import BoardView, find_board
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.compiled import FloatArray
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
    there = {(frame.frame, frame.files) for frame in frames if frame.reviewed or frame.corrected}
    edits: list[Edit] = []
    for (text,) in rows:
        with suppress(*DAMAGED):
            item = json.loads(text)
            edits.append(Edit(*(frame_from_json(item[when]) for when in ("before", "after"))))
    known = [edit for edit in edits if (edit.after.frame, edit.after.files) in there]
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


def thumbnail(store: ProjectPhotographs, frame: Frame) -> bytes:
    """A JPEG of both photographs around the targets."""
    return _drawn(_files(store, frame.files), frame.centres)


def pair_thumbnail(store: ProjectPhotographs, names: tuple[str | None, str | None]) -> bytes:
    """A JPEG of two whole photographs; grey where there is none."""
    return _drawn(_files(store, names), ((None, None), (None, None)))


def board_thumbnail(
    store: ProjectPhotographs, pair: Pair, corners: tuple[FloatArray, FloatArray]
) -> bytes:
    """A JPEG of both photographs, with the corners (n, 2) of the board in each."""
    marks = tuple(own.astype(np.float64).tobytes() for own in corners)
    return _drawn(_files(store, (pair.primary, pair.secondary)), marks)


def held_thumbnail(
    store: ProjectPhotographs, pair: Pair, points: tuple[FloatArray, FloatArray]
) -> bytes:
    """A JPEG of both photographs, with the two targets, the corners or the markers (n, 2) px that
    were found in each."""
    if all(len(own) in (0, 2) for own in points):
        marks = tuple(_centres(own) for own in points)
        return _drawn(_files(store, (pair.primary, pair.secondary)), marks)
    return board_thumbnail(store, pair, points)


@lru_cache(maxsize=200)
def board_corners(file: StoredFile, pattern: BoardPattern) -> FloatArray:
    """(n, 2): the corners of the board in a photograph; none if it shows none."""
    image = _image(file)
    found = None if image is None else find_board(image, pattern, "")
    return found.corners if isinstance(found, BoardView) else np.empty((0, 2))


@lru_cache(maxsize=4000)
def _drawn(files: tuple[StoredFile | None, ...], marks: Sequence[CentrePair | bytes]) -> bytes:
    """Both tiles, with their targets or the bytes of the corners of their board."""
    first, second = (
        board_tile(_image(file), np.frombuffer(own).reshape(-1, 2))
        if isinstance(own, bytes)
        else tile(_image(file), own)
        for file, own in zip(files, marks, strict=True)
    )
    return side_by_side(first, second)


def _centres(points: FloatArray) -> CentrePair:
    if not len(points):
        return None, None
    a, b = points.tolist()
    return Centre(*a), Centre(*b)


def _files(store: ProjectPhotographs, names: Sequence[str | None]) -> tuple[StoredFile | None, ...]:
    photographs = store.photographs
    return tuple(photographs.get(name) if name else None for name in names)


def _image(file: StoredFile | None) -> GreyImage | None:
    try:
        return read_photograph(file) if file else None
    except StereocalError:
        return None
