"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from stereocal.errors import StereocalError


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path`, whole or not at all.

    Raises:
        StereocalError: the folder cannot be written to, or the disk is full.
    """
    write_all({path: content})


def write_all(files: Mapping[Path, bytes]) -> None:
    """Write several files: temporary files beside them, flushed to disk, then all renamed.

    Raises:
        StereocalError: a folder cannot be written to, or the disk is full; nothing has changed.
    """
    waiting: list[tuple[Path, Path]] = []
    try:
        for path, content in files.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
            waiting.append((Path(name), path))
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(name).chmod(0o644)
        for path in files:
            if path.is_dir():
                raise IsADirectoryError(0, "it is a folder", str(path))
        for temporary, path in waiting:
            temporary.replace(path)
    except OSError as error:
        where = ", ".join(str(path) for path in files)
        raise StereocalError(f"{where} cannot be written: {error.strerror or error}.") from error
    finally:
        for temporary, _ in waiting:
            temporary.unlink(missing_ok=True)


@contextmanager
def write_in_parts(path: Path) -> Iterator[Path]:
    """A temporary file beside `path` to write to piece by piece; it becomes `path` at the end.

    Raises:
        StereocalError: the folder cannot be written to, or the disk is full. After this or any
            other error inside the `with`, `path` is as it was.
    """
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise IsADirectoryError(0, "it is a folder", str(path))
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        os.close(handle)
        temporary = Path(name)
        yield temporary
        with temporary.open("rb") as file:
            os.fsync(file.fileno())
        temporary.chmod(0o644)
        temporary.replace(path)
    except OSError as error:
        raise StereocalError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
