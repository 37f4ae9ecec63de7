"""Thumbnails of a project's frames, made when first shown."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from stereocal.errors import StereocalError
from stereocal.frames.frame import CentrePair, Frame
from stereocal.frames.pairing import Pair
from stereocal.frames.thumbnails import board_tile, side_by_side, tile
from stereocal.intrinsics.boards import BoardView, find_board
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.compiled import FloatArray
from stereocal.system.photograph import GreyImage, read_photograph


def thumbnail(store: ProjectPhotographs, frame: Frame) -> bytes:
    """A JPEG of both photographs around the targets."""
    photographs = store.photographs
    primary, secondary = (photographs.get(name) for name in frame.files)
    return _thumbnail(primary, secondary, frame.centres)


def board_thumbnail(
    store: ProjectPhotographs, pair: Pair, corners: tuple[FloatArray, FloatArray]
) -> bytes:
    """A JPEG of both photographs, with the corners (n, 2) of the board in each."""
    photographs = store.photographs
    primary, secondary = (photographs.get(name) for name in (pair.primary, pair.secondary))
    first, second = (own.astype(np.float64).tobytes() for own in corners)
    return _board_thumbnail(primary, secondary, first, second)


@lru_cache(maxsize=2000)
def _board_thumbnail(
    primary: StoredFile | None, secondary: StoredFile | None, first: bytes, second: bytes
) -> bytes:
    a, b = (np.frombuffer(own).reshape(-1, 2) for own in (first, second))
    return side_by_side(board_tile(_image(primary), a), board_tile(_image(secondary), b))


@lru_cache(maxsize=200)
def board_corners(file: StoredFile, pattern: BoardPattern) -> FloatArray:
    """(n, 2): the corners of the board in a photograph; none if it shows none."""
    image = _image(file)
    found = None if image is None else find_board(image, pattern, "")
    return found.corners if isinstance(found, BoardView) else np.empty((0, 2))


@lru_cache(maxsize=2000)
def _thumbnail(
    primary: StoredFile | None, secondary: StoredFile | None, centres: tuple[CentrePair, CentrePair]
) -> bytes:
    return side_by_side(tile(_image(primary), centres[0]), tile(_image(secondary), centres[1]))


def _image(file: StoredFile | None) -> GreyImage | None:
    try:
        return read_photograph(file) if file else None
    except StereocalError:
        return None
