"""The list of a project's photographs on disk, with the pairs as a person has edited them.

`photographs/photographs.json` below the project's folder: `files` (where each photograph is, by the
person's name), `pairs`, and at times

- `found_by`: which search found the targets (`ProjectPhotographs.keep_found`);
- `outdated`: names whose photographs were replaced since the targets were found;
- `coming`: the photographs of a data set that is being taken over. They are the project's as soon
  as `project.json` counts the data set, whatever becomes of the server.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stereocal.errors import StereocalError, can_be_shown
from stereocal.frames.pairing import Pairing, pair_names
from stereocal.project import Project
from stereocal.store.folders import own_file
from stereocal.store.pair_rows import PairRow, check_rows, merged, row_of
from stereocal.store.state import DamagedError, StateFile, changing, forget

STORE_FORMAT = "stereocal-photographs/1"


class PhotographList:
    """Which photographs a project has. Every change is on disk when its method returns."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self.folder = project.folder / "photographs"
        self.files = self.folder / "files"
        """Where `photograph_files` stores what comes from a zip or an upload."""
        self._file = StateFile(
            project.folder, self.folder / "photographs.json", STORE_FORMAT, _check,
            {"files": {}, "pairs": None}, "The list of photographs",
            "remove all photographs, and give them again", ("frames.json",),
        )  # fmt: skip

    @property
    def photographs(self) -> dict[str, Path]:
        """Files on disk by the person's names."""
        stored: Mapping[str, str] = self._read()["files"]
        return {name: own_file(self.files, file) for name, file in stored.items()}

    @property
    def proposal(self) -> Pairing:
        """The pairs as the names tell them."""
        return pair_names(self._read()["files"])

    @property
    def rows(self) -> list[PairRow]:
        """The pairs as edited, or as proposed while nobody has."""
        edited = self._read()["pairs"]
        if edited is None:
            return [PairRow(pair) for pair in self.proposal.pairs]
        return [row_of(item) for item in edited]

    def keep_rows(self, rows: Sequence[PairRow] | None) -> None:
        """Keep the pairs as edited; None goes back to the proposal.

        Raises:
            StereocalError: a frame or a photograph stands in two rows, or a name is none.
        """
        with self._change() as state:
            if rows is not None:
                check_rows(rows, state["files"])
            state["pairs"] = None if rows is None else [asdict(row) for row in rows]

    def change_rows(self, before: Sequence[PairRow], after: Sequence[PairRow]) -> list[PairRow]:
        """Keep the pairs as edited from `before`; what others have changed since stays.

        Where both have changed the same pair, this edit holds.

        Raises:
            StereocalError: as `keep_rows`.
        """
        with self._change() as state:
            check_rows(after, state["files"])
            rows = merged(before, after, self.rows)
            check_rows(rows, state["files"])
            state["pairs"] = [asdict(row) for row in rows]
        return rows

    @contextmanager
    def _announced(self, names: Mapping[str, str], project: dict[str, Any]) -> Iterator[None]:
        """Have these photographs (files by name) as soon as the project's state is written inside.

        Args:
            project: that state, to which it adds what tells.
        """
        times = project["times_given"] = project.get("times_given", 0) + 1
        coming = {"times_given": times, "files": names}
        self._file.write({**self._file.read(), "coming": coming})
        try:
            yield
        finally:
            with suppress(StereocalError):  # the next change does it
                self._arrive()

    def _arrive(self) -> None:
        """Bring the list to what holds, if a server died while photographs were coming."""
        try:
            state, now = self._file.read(), self._read()
        except DamagedError:
            return
        if "coming" in state:
            if self._has_come(state):
                self._forget_found()
            self._file.write(now)

    def _has_come(self, state: Mapping[str, Any]) -> bool:
        """Whether the project has taken over the photographs that are coming."""
        return "coming" in state and bool(
            state["coming"]["times_given"] == self.project.times_given
        )

    def _read(self) -> dict[str, Any]:
        """What holds of the list, in which photographs may be coming."""
        state = self._file.read()
        if self._has_come(state):
            return {**self._file.blank(), "files": state["coming"]["files"]}
        return {key: value for key, value in state.items() if key != "coming"}

    def _forget_found(self) -> None:
        for name in ("frames.json", "edits.json"):
            forget(self.folder / name)

    @contextmanager
    def _change(self) -> Iterator[dict[str, Any]]:
        with changing(self.project.folder):
            self._arrive()
            with self._file.change() as state:
                yield state


def _check(state: dict[str, Any]) -> None:
    _check_files(state["files"])
    if state["pairs"] is not None and not isinstance(state["pairs"], list):
        raise TypeError(state["pairs"])
    for item in state["pairs"] or []:
        row_of(item)
    if not all(isinstance(name, str) for name in state.get("outdated", ())):
        raise TypeError(state["outdated"])
    if "coming" in state:
        if not isinstance(state["coming"]["times_given"], int):
            raise TypeError(state["coming"])
        _check_files(state["coming"]["files"])


def _check_files(files: Mapping[Any, Any]) -> None:
    for name, file in files.items():
        if not can_be_shown(name) or not isinstance(file, str):
            raise TypeError(name)
