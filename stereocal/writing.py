"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from stereocal.errors import StereocalError


def write_atomically(path: Path, content: bytes) -> None:
    """Write `content` to `path`: a temporary file beside it, flushed to disk, then renamed.

    Raises:
        StereocalError: the folder cannot be written to, or the disk is full.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            Path(name).chmod(0o644)
            Path(name).replace(path)
        except BaseException:
            Path(name).unlink(missing_ok=True)
            raise
    except OSError as error:
        raise StereocalError(f"{path} cannot be written: {error.strerror or error}.") from error
