"""Small pictures of the frames of a project, kept on disk (`frames.thumbnails` makes them)."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.frames.frame import Frame
from stereocal.frames.thumbnails import side_by_side, tile
from stereocal.store.photographs import ProjectPhotographs
from stereocal.system.atomic_files import write_atomically
from stereocal.system.photograph import GreyImage, read_photograph


def thumbnail(store: ProjectPhotographs, frame: Frame) -> bytes:
    """A JPEG of both photographs around the targets, made now if it is not there yet."""
    photographs = store.photographs
    paths = [photographs.get(name) for name in frame.files]
    made_of = json.dumps([[p and p.name for p in paths], asdict(frame)["centres"]])
    name = hashlib.sha256(made_of.encode()).hexdigest()[:32]
    path = store.folder / "thumbnails" / f"{name}.jpg"
    if path.is_file():
        return path.read_bytes()
    first, second = (
        tile(_image(path), centres) for path, centres in zip(paths, frame.centres, strict=True)
    )
    content = side_by_side(first, second)
    write_atomically(path, content)
    return content


def _image(path: Path | None) -> GreyImage | None:
    try:
        return read_photograph(path) if path else None
    except StereocalError:
        return None
