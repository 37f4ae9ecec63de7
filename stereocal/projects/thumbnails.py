"""Thumbnails of a project's frames, made when first shown."""

from __future__ import annotations

from functools import lru_cache

from stereocal.errors import StereocalError
from stereocal.frames.frame import CentrePair, Frame
from stereocal.frames.thumbnails import side_by_side, tile
from stereocal.projects.files import StoredFile
from stereocal.projects.photographs import ProjectPhotographs
from stereocal.system.photograph import GreyImage, read_photograph


def thumbnail(store: ProjectPhotographs, frame: Frame) -> bytes:
    """A JPEG of both photographs around the targets."""
    photographs = store.photographs
    primary, secondary = (photographs.get(name) for name in frame.files)
    return _thumbnail(primary, secondary, frame.centres)


@lru_cache(maxsize=2000)
def _thumbnail(
    primary: StoredFile | None,
    secondary: StoredFile | None,
    centres: tuple[CentrePair, CentrePair],
) -> bytes:
    return side_by_side(tile(_image(primary), centres[0]), tile(_image(secondary), centres[1]))


def _image(file: StoredFile | None) -> GreyImage | None:
    try:
        return read_photograph(file) if file else None
    except StereocalError:
        return None
