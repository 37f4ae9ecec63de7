"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
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
