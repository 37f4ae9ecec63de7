"""Atomic and durable writing: files appear complete or not at all, and survive a power cut.

A temporary file beside the target is written, flushed and renamed; then the folder is flushed,
without which the new name may be lost.
"""

import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np

from stereocal.errors import StereocalError, disk_errors


def make_folder(path: Path) -> None:
    """Make a folder and its missing parents durably.

    Raises:
        OSError: it cannot be made.
    """
    if path.is_dir():
        return
    make_folder(path.parent)
    with suppress(FileExistsError):  # made by another thread; if it is a file, its use will fail
        path.mkdir()
    flush_folder(path.parent)


def flush_folder(path: Path) -> None:
    """Flush the names in a folder to disk.

    Raises:
        OSError: the flush fails.
    """
    if os.name == "nt":  # folders cannot be opened on Windows; NTFS keeps a journal
        return
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def read_whole(path: str | Path, most: float = np.inf) -> bytes:
    """The content of a file of at most `most` bytes."""
    with disk_errors(f"{path} cannot be read"):
        if (size := Path(path).stat().st_size) > most:
            raise StereocalError(f"{path}: {size} bytes are too many (at most {most:.0f}).")
        return Path(path).read_bytes()


def write_atomically(path: Path, content: bytes) -> None:
    write_all({path: content})


def write_all(files: Mapping[Path, bytes]) -> None:
    """Write several files, each atomically; folders are completed in order.

    All temporary files are written before the first is renamed.

    Raises:
        StereocalError: a folder cannot be written to, or the disk is full. Nothing has changed
            then, unless the disk fails between two renames.
    """
    with _replaced(list(files)) as parts:
        for part, content in zip(parts, files.values(), strict=True):
            part.write_bytes(content)


@contextmanager
def write_in_parts(path: Path) -> Iterator[Path]:
    """A temporary file beside `path` to write to; it is renamed to `path` at the end.

    Raises:
        StereocalError: the folder cannot be written to, or the disk is full. After this or any
            other error inside the `with`, `path` is as it was.
    """
    with _replaced([path]) as (part,):
        yield part


@contextmanager
def _replaced(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """A temporary file beside each path, which replaces it at the end."""
    parts = [path.parent / f".{path.name}.{secrets.token_hex(4)}" for path in paths]
    try:
        for path, part in zip(paths, parts, strict=True):
            make_folder(path.parent)
            if path.is_dir():
                raise IsADirectoryError(0, "it is a folder", str(path))
            part.touch(exist_ok=False)
        yield parts
        for part in parts:
            with part.open("r+b") as file:  # Windows flushes writable files only
                os.fsync(file.fileno())
            part.chmod(0o644)
        for folder in dict.fromkeys(path.parent for path in paths):
            for path, part in zip(paths, parts, strict=True):
                if path.parent == folder:
                    part.replace(path)
            flush_folder(folder)
    except OSError as error:
        where = ", ".join(path.name for path in paths)
        raise StereocalError(f"{where} cannot be written: {error.strerror or error}.") from error
    finally:
        for part in parts:
            with suppress(OSError):  # the server's clean-up does it later
                part.unlink(missing_ok=True)
