"""Photographs from a folder, a zip or an upload, as files on disk.

At most one photograph is in memory. Those from a zip or an upload are stored under a digest of
their content, never under their own name.
"""

import hashlib
import os
from collections.abc import Iterable, Mapping
from concurrent.futures import Executor
from pathlib import Path, PurePosixPath
from typing import TypeVar

from stereocal.errors import StereocalError, disk_errors
from stereocal.system.executors import is_cluster
from stereocal.system.limits import Limits
from stereocal.system.photograph import SUFFIXES, FileContent, PhotographFile
from stereocal.system.tasks import Progress
from stereocal.system.zip_files import open_zip

Photographs = Mapping[str, FileContent]
"""Files by the user's names, with folders and forward slashes."""
F = TypeVar("F")


def is_photograph(name: str) -> bool:
    """Whether a file's name is that of a photograph, and not a hidden file."""
    path = PurePosixPath(name.replace("\\", "/"))
    return path.suffix.lower() in SUFFIXES and not is_hidden(name)


def is_hidden(name: str) -> bool:
    """Whether a file is one that systems leave in folders and zips."""
    parts = PurePosixPath(name.replace("\\", "/")).parts
    hidden = any(part.startswith((".", "__MACOSX")) and part != ".." for part in parts)
    return hidden or parts[-1:] in (("Thumbs.db",), ("desktop.ini",))


def of_the_bar(photographs: Mapping[str, F]) -> Mapping[str, F]:
    """Those in folders `primary` and `secondary`, if both exist; else all.

    Other folders of a data set may contain photographs of boards.
    """
    by_side: dict[str, dict[str, F]] = {"primary": {}, "secondary": {}}
    for name, path in photographs.items():
        folder = PurePosixPath(name).parent.name.lower()
        if folder in by_side:
            by_side[folder][name] = path
    of_sides = by_side["primary"] | by_side["secondary"]
    return of_sides if all(by_side.values()) else photographs


def photographs_in(source: Path, store: Path, progress: Progress | None = None) -> dict[str, Path]:
    """The photographs in a folder, or in a zip, unpacked into `store`."""
    if source.is_dir():
        paths = {path.relative_to(source).as_posix(): path for path in sorted(source.rglob("*"))}
        photographs = {n: path for n, path in paths.items() if is_photograph(n) and path.is_file()}
        Limits.from_environment().check_count(len(photographs), str(source))
    elif source.is_file():
        photographs = unpack_photographs(source, source.name, store, progress)
    else:
        raise StereocalError(f"{source}: there is no such folder or file.")
    if not photographs:
        raise StereocalError(
            f"{source}: there is no photograph in it (PNG, JPEG, TIFF, BMP or PGM); "
            "`detect` takes videos with --videos."
        )
    return photographs


def photographs_of(sources: Iterable[Path], store: Path) -> dict[str, Path]:
    """The photographs of files, folders and zips, those unpacked into `store`; of two with one name
    the second has that of its source too."""
    return {name: path for name, _, path in named_photographs(sources, store)}


def named_photographs(sources: Iterable[Path], store: Path) -> list[tuple[str, str, Path]]:
    """The photographs of `photographs_of`, each with two names: the second is the path as far as
    the sources differ in theirs, which may tell the camera."""
    sources = [*sources]
    folders = [
        source.absolute() if source.is_dir() else source.absolute().parent for source in sources
    ]
    common = os.path.commonpath(folders) if folders else ""
    photographs: dict[str, tuple[str, Path]] = {}
    for source, folder in zip(sources, folders, strict=True):
        is_zip = source.suffix.lower() == ".zip"
        alone = source.is_file() and not is_zip
        inside = folder.relative_to(common) / (source.stem if is_zip and len(sources) > 1 else "")
        photographs_here = {source.name: source} if alone else photographs_in(source, store)
        for name, path in photographs_here.items():
            unique = name if name not in photographs else str(source / name)
            photographs[unique] = (inside / name).as_posix(), path
    return [(name, whole, path) for name, (whole, path) in photographs.items()]


def unpack_photographs(
    source: Path | bytes, name: str, store: Path, progress: Progress | None = None
) -> dict[str, Path]:
    """Unpack the photographs of a zip into the folder `store`, one at a time, with their times."""
    photographs = {}
    with open_zip(source, name) as opened:
        names = [member for member in opened.names if is_photograph(member)]
        for done, member in enumerate(names, start=1):
            content, modified = opened.read(member), opened.modified(member)
            suffix = PurePosixPath(member).suffix.lower()
            path = store / f"{hashlib.sha256(content).hexdigest()[:32]}{suffix}"
            with disk_errors(f"{member} cannot be stored"):
                store.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
                if modified is not None:
                    os.utime(path, (modified, modified))
            photographs[member] = path
            if progress:
                progress(done, len(names))
    return photographs


def for_worker(path: FileContent, executor: Executor) -> PhotographFile:
    """The photograph as an argument of a task: by path if the worker can read this disk."""
    if not is_cluster(executor):
        return path
    try:
        return path.read_bytes()
    except OSError:  # the worker will report it
        return path
