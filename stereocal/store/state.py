"""What a project knows, as small JSON files that are read, edited and replaced as a whole."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from stereocal.errors import DAMAGED, StereocalError
from stereocal.locking import locked
from stereocal.system.atomic_files import flush_folder, write_atomically

PROJECT_FILE = "project.json"
"""What makes a folder a project."""


class DamagedError(StereocalError):
    """A file of a project that cannot be read: not one of another version."""


@contextmanager
def changing(project: Path) -> Iterator[None]:
    """Have a project's folder for oneself: read, edit and replace inside.

    Threads and processes wait for each other; other projects go on. Nothing is written into a
    project that was removed meanwhile.

    Raises:
        StereocalError: the project was removed, or nothing can be written to it.
    """
    _refuse_removed(project)
    with locked(project):
        _refuse_removed(project)
        yield


def _refuse_removed(project: Path) -> None:
    if not (project / PROJECT_FILE).is_file():
        raise StereocalError(
            "This project was removed meanwhile, and nothing more is written to it. It can be "
            "brought back on the Start page where it was removed."
        )


@dataclass(frozen=True)
class StateFile:
    """One such file of a project."""

    project: Path
    """The project's folder."""
    path: Path
    version: str
    """What its `format` says, with a number at the end."""
    check: Callable[[dict[str, Any]], object]
    """Looks at all that is read; KeyError, TypeError or ValueError if something is amiss."""
    empty: Mapping[str, Any] | None
    """What is in it before it is there; None: it must be there."""
    what: str
    """As messages call it: "The list of photographs"."""
    advice: str
    """What to do if it is damaged."""
    followers: tuple[str, ...] = ()
    """Files beside it that are never there before it: if one is, this one has gone."""

    def read(self) -> dict[str, Any]:
        """The content.

        Raises:
            StereocalError: damaged, or of another version; says what to do.
        """
        try:
            state = json.loads(self.path.read_bytes())
            if isinstance(state, dict) and state.get("format") != self.version:
                raise _OtherVersionError(self._other_version(state.get("format")))
            self.check(state)
        except FileNotFoundError as error:
            if self.empty is None:
                raise StereocalError(f"{self.what} is not there; {self.advice}.") from error
            if any((self.path.parent / name).exists() for name in self.followers):
                raise DamagedError(f"{self.what} has gone; {self.advice}.") from error
            return self.blank()
        except _OtherVersionError:
            raise
        except OSError as error:
            raise StereocalError(
                f"{self.what} cannot be read: {error.strerror or error}."
            ) from error
        except DAMAGED as error:
            raise DamagedError(f"{self.what} is damaged; {self.advice}.") from error
        return dict(state)

    @contextmanager
    def change(self) -> Iterator[dict[str, Any]]:
        """The content, to be edited; it is on disk when the block has ended without an error.

        Raises:
            StereocalError: as `read` and `changing`; nothing has changed.
        """
        with changing(self.project):
            state = self.read()
            yield state
            self.write(state)

    def write(self, state: Mapping[str, Any]) -> None:
        """Replace the content, whatever it was."""
        write_atomically(self.path, self.pack(state))

    def pack(self, state: Mapping[str, Any]) -> bytes:
        """The bytes of a content."""
        return json.dumps(state, indent=1, allow_nan=False).encode()

    def blank(self) -> dict[str, Any]:
        """What is in it before anything is."""
        copy: dict[str, Any] = json.loads(json.dumps(self.empty or {}))
        return {"format": self.version, **copy}

    def _other_version(self, given: object) -> str:
        ours, theirs = (_number(text) for text in (self.version, given))
        if theirs is not None and ours is not None and theirs > ours:
            return (
                f"{self.what} was written by a newer version of stereocal ({given}): update "
                "stereocal to open it. It is left as it is."
            )
        return f"{self.what} was written by another version of stereocal."


class _OtherVersionError(StereocalError):
    pass


def _number(text: object) -> int | None:
    found = re.fullmatch(r"stereocal-[a-z]+/(\d{1,9})", text) if isinstance(text, str) else None
    return int(found[1]) if found else None


def read_if_there(path: Path, advice: str) -> bytes | None:
    """The content of a file of a project; None if there is none.

    Raises:
        StereocalError: it cannot be read.
    """
    try:
        return path.read_bytes()
    except FileNotFoundError:
        return None
    except OSError as error:
        reason = error.strerror or error
        raise StereocalError(f"{path.name} cannot be read ({reason}); {advice}.") from error


def forget(path: Path) -> None:
    """Remove a file of a project, if it is there.

    Raises:
        StereocalError: it cannot be removed.
    """
    try:
        path.unlink(missing_ok=True)
    except OSError as error:
        raise StereocalError(f"{path.name} cannot be removed: {error.strerror}.") from error


def flush_stored(found: Mapping[str, Path], folder: Path) -> None:
    """Make sure that stored files are there, before something names them.

    Raises:
        StereocalError: one has gone, or the disk fails.
    """
    for name, path in found.items():
        if not path.is_file():
            raise StereocalError(f"{name} has gone from the project's folder; give it again.")
    try:
        flush_folder(folder)
    except OSError as error:
        raise StereocalError(f"{folder.name} cannot be written: {error.strerror}.") from error
