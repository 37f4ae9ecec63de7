"""Files that appear whole or not at all, and that are there after a power cut.

A temporary file beside the target is written and flushed, renamed, and then its folder is flushed:
without that the new name may be lost, though the content is not.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from stereocal.errors import StereocalError


def make_folder(path: Path) -> None:
    """Make a folder, and those above that are missing, so that they are there after a power cut.

    Raises:
        OSError: it cannot be made.
    """
    if path.is_dir():
        return
    make_folder(path.parent)
    with suppress(FileExistsError):  # by another thread; what is no folder fails when it is used
        path.mkdir()
    flush_folder(path.parent)


def flush_folder(path: Path) -> None:
    """Wait until the names in a folder are on the disk.

    Raises:
        OSError: they cannot be brought there.
    """
    if os.name == "nt":  # a folder cannot be opened there; the file system keeps a journal
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def flush_file(path: Path) -> None:
    """Wait until a file's content is on the disk.

    Raises:
        OSError: it cannot be brought there.
    """
    with path.open("r+b") as file:  # Windows flushes only what may be written to
        os.fsync(file.fileno())


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path`, whole or not at all.

    Raises:
        StereocalError: the folder cannot be written to, or the disk is full.
    """
    write_all({path: content})


def write_all(files: Mapping[Path, bytes]) -> None:
    """Write several files, each whole; a later folder's files appear after an earlier one's.

    Temporary files are written beside all of them before the first is renamed.

    Raises:
        StereocalError: a folder cannot be written to, or the disk is full. Nothing has changed but
            where the disk fails between two renames, which need no room.
    """
    waiting: list[tuple[Path, Path]] = []
    try:
        for path, content in files.items():
            make_folder(path.parent)
            if path.is_dir():
                raise IsADirectoryError(0, "it is a folder", str(path))
            handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
            waiting.append((Path(name), path))
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(name).chmod(0o644)
        for folder in dict.fromkeys(path.parent for path in files):
            for temporary, path in waiting:
                if path.parent == folder:
                    temporary.replace(path)
            flush_folder(folder)
    except OSError as error:
        where = ", ".join(path.name for path in files)
        raise StereocalError(f"{where} cannot be written: {error.strerror or error}.") from error
    finally:
        for temporary, _ in waiting:
            _remove(temporary)


@contextmanager
def write_in_parts(path: Path) -> Iterator[Path]:
    """A temporary file beside `path` to write to piece by piece; it becomes `path` at the end.

    Raises:
        StereocalError: the folder cannot be written to, or the disk is full. After this or any
            other error inside the `with`, `path` is as it was.
    """
    temporary: Path | None = None
    try:
        make_folder(path.parent)
        if path.is_dir():
            raise IsADirectoryError(0, "it is a folder", str(path))
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
        temporary = Path(name)
        yield temporary
        flush_file(temporary)
        temporary.chmod(0o644)
        temporary.replace(path)
        flush_folder(path.parent)
    except OSError as error:
        raise StereocalError(
            f"{path.name} cannot be written: {error.strerror or error}."
        ) from error
    finally:
        if temporary is not None:
            _remove(temporary)


def _remove(path: Path) -> None:
    """Remove a temporary file; where even that fails, the sweep of the server will."""
    with suppress(OSError):
        path.unlink(missing_ok=True)
