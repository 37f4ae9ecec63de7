"""A file of results as JSON that states its format, the software and the date."""

import datetime
import json
import platform
from abc import ABC, abstractmethod
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar, Self

import cv2
import numba
import numpy as np
import scipy

from stereocal.errors import DAMAGED, StereocalError, naming
from stereocal.system.arguments import checked
from stereocal.system.atomic_files import read_whole, write_atomically
from stereocal.system.json_text import read_json
from stereocal.system.made_from import digest_of
from stereocal.version import __version__

OF_OTHERS = "Parameters of another program are read first, by stereocal convert --from PROGRAM."


def software_versions() -> dict[str, str]:
    """The `software` entry of a file: versions on which its numbers depend."""
    return {
        "stereocal": __version__,
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "numba": numba.__version__,
        "opencv": cv2.__version__,
    }


class ResultFile(ABC):
    """What a file holds; equal content gives equal text, except for `created`."""

    CALLED: ClassVar[str]
    """In messages, such as `parameter file`."""
    SOURCE: ClassVar[str]
    """In messages about a text whose file is not known."""
    READS: ClassVar[Mapping[str, str]]
    """The `format`, and what else must stand in the file."""
    INDENT: ClassVar[int]
    LARGEST: ClassVar[float] = np.inf
    """In bytes."""

    @abstractmethod
    def content(self) -> dict[str, Any]:
        """The content of the file, but for software and date."""

    @classmethod
    @abstractmethod
    def _of_content(cls, data: Mapping[str, Any]) -> Self:
        """The inverse; any exception of `DAMAGED` means a damaged file."""

    def to_json(self) -> dict[str, Any]:
        """The content of the file."""
        created = datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds")
        return {**self.content(), "software": software_versions(), "created": created}

    @cached_property
    def digest(self) -> str:
        """Identifies the content, independent of date and version."""
        return digest_of(self.content())

    def dumps(self) -> str:
        """The file as text."""
        return json.dumps(self.to_json(), indent=self.INDENT, allow_nan=False) + "\n"

    @checked
    def save(self, path: str | Path) -> None:
        """Write the file, whole or not at all."""
        write_atomically(Path(path), self.dumps().encode())

    @classmethod
    @checked
    def load(cls, path: str | Path) -> Self:
        """Read a file."""
        if Path(path).is_dir():
            raise StereocalError(f"{path} is a folder, and no {cls.CALLED}. {OF_OTHERS}")
        return cls.loads(read_whole(path, cls.LARGEST), str(path))

    @classmethod
    def loads(cls, text: str | bytes, source: str = "") -> Self:
        """The result that a text holds, as `load` reads it; `source` names the text in messages."""
        source = source or cls.SOURCE
        if len(text) > cls.LARGEST:
            raise StereocalError(
                f"{source}: {len(text)} bytes are too many for a {cls.CALLED} "
                f"(at most {cls.LARGEST})."
            )
        # Other programs write YAML, TOML or XML; a byte order mark may precede ours.
        ours = text.lstrip()[:1] in ("{", b"{", "\ufeff", b"\xef")
        data: Any = read_json(text, source) if ours else None
        file_format = data.get("format") if isinstance(data, dict) else None
        with naming(source):
            if file_format is None:
                raise StereocalError(f"this is no {cls.CALLED}. {OF_OTHERS}")
            if any(data.get(key) != value for key, value in cls.READS.items()):
                reads = " with the convention ".join(f'"{value}"' for value in cls.READS.values())
                raise StereocalError(f"the format is {file_format!r}; this version reads {reads}.")
            try:
                return cls._of_content(data)
            except StereocalError:
                raise
            except DAMAGED as error:
                raise StereocalError(
                    f"the {cls.CALLED} is damaged ({type(error).__name__}: {error})."
                ) from error
