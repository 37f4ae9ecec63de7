"""Photographs from a folder, a zip or an upload: each a file on disk, read when its turn comes.

Nothing here holds more than one photograph in memory, and what comes from a zip or an upload is
stored under a name made from its content, never under its own.
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

from stereocal.errors import StereocalError
from stereocal.locking import FileLock
from stereocal.store.room import check_room
from stereocal.system.atomic_files import make_folder
from stereocal.system.limits import Limits
from stereocal.system.photograph import SUFFIXES
from stereocal.system.zip_files import open_zip

Photographs = Mapping[str, Path]
"""Names as the person has them, with folders and forward slashes, to files on disk."""
Progress = Callable[[int, int], None]


def is_photograph(name: str) -> bool:
    """Whether a file's name is a photograph's, and not one that a system has hidden there."""
    path = PurePosixPath(name.replace("\\", "/"))
    hidden = any(part.startswith((".", "__MACOSX")) and part != ".." for part in path.parts)
    return path.suffix.lower() in SUFFIXES and not hidden


def of_the_bar(photographs: Photographs) -> Photographs:
    """Those in folders `primary` and `secondary`, where a data set has them; else all.

    Photographs of a board, for the lenses, may lie beside them in folders of their own.
    """
    own: dict[str, dict[str, Path]] = {"primary": {}, "secondary": {}}
    for name, path in photographs.items():
        folder = PurePosixPath(name).parent.name.lower()
        if folder in own:
            own[folder][name] = path
    both = own["primary"] | own["secondary"]
    return both if all(own.values()) else photographs


def photographs_in(source: Path, store: Path, progress: Progress | None = None) -> Photographs:
    """The photographs of a folder, where they lie, or of a zip, unpacked into `store`.

    Raises:
        StereocalError: there is no such folder or zip, or it holds no photograph.
    """
    if source.is_dir():
        found: dict[str, Path] = {}
        for path in sorted(source.rglob("*")):
            name = path.relative_to(source).as_posix()
            if is_photograph(name) and path.is_file():
                found[name] = path
        Limits.from_environment().check_count(len(found), str(source))
    elif source.is_file():
        found = unpack_photographs(source, source.name, store, progress)
    else:
        raise StereocalError(f"{source}: there is no such folder or file.")
    if not found:
        raise StereocalError(
            f"{source}: there is no photograph in it (PNG, JPEG, TIFF, BMP or PGM)."
        )
    return found


def unpack_photographs(
    source: Path | bytes, name: str, store: Path, progress: Progress | None = None
) -> dict[str, Path]:
    """Unpack the photographs of a zip into the folder `store`, one at a time.

    Raises:
        StereocalError: as `zip_files.open_zip`, too much for the project, or the disk is full.
    """
    with open_zip(source, name) as opened:
        names = [member for member in opened.names if is_photograph(member)]
        check_room(store, sum(map(opened.size, names)))
        found = {}
        for done, member in enumerate(names):
            found[member] = keep_photograph(opened.pieces(member), member, store)
            if progress:
                progress(done + 1, len(names))
        return found


def keep_photograph(pieces: Iterable[bytes], name: str, store: Path) -> Path:
    """Write a photograph's file into `store`, named by its content; the same one only once.

    Its content is on the disk when this returns; its name is when `writing.flush_folder` was called
    on `store`, once for all photographs.

    Raises:
        StereocalError: the folder cannot be written to, or the disk is full.
    """
    suffix = PurePosixPath(name).suffix.lower()
    digest = hashlib.sha256()
    lock = None
    try:
        make_folder(store)
        handle, temporary = tempfile.mkstemp(dir=store, prefix=".new-")
        os.close(handle)
        lock = FileLock(Path(temporary))  # so that nobody sweeps it
        lock.acquire()
        with lock.path.open("wb") as file:
            for piece in pieces:
                digest.update(piece)
                file.write(piece)
            file.flush()
            os.fsync(file.fileno())
        path = store / f"{digest.hexdigest()[:32]}{suffix if suffix in SUFFIXES else ''}"
        lock.path.replace(path)
    except OSError as error:
        raise StereocalError(f"{name} cannot be stored: {error.strerror or error}.") from error
    finally:
        if lock is not None:
            with suppress(OSError):
                lock.path.unlink(missing_ok=True)
            lock.release()
    return path
