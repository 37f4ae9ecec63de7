"""The photographs of a project on disk: files, pairs, found targets, small pictures.

Below the project's folder, in `photographs/`:

- `files/<digest>.<suffix>`: the photographs as given, never changed once written.
- `photographs.json`: their names and the pairs as the person has edited them. While a data set is
  taken over, `coming` beside them: the photographs that it brings. They are the project's as soon
  as `project.json` counts the data set, whatever becomes of the server (`give`).
  `searched`: of which of them the targets were found.
- `frames.json`: where the targets are (`frames.pack_frames`).
- `thumbnails/`: made when they are first shown.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stereocal.errors import RefusedRowsError, StereocalError, can_be_shown
from stereocal.formats.correspondences_csv import write_table
from stereocal.frames.frame import Frame, correspondences_of, pack_frames, unpack_frames
from stereocal.frames.pairing import Pairing, pair_names
from stereocal.frames.search import keep_corrections
from stereocal.inputs import Slot
from stereocal.project import Project
from stereocal.store.folders import own_file
from stereocal.store.pair_rows import PairRow, check_rows, merged, row_of, with_new
from stereocal.store.state import (
    DamagedError,
    StateFile,
    changing,
    flush_stored,
    forget,
    read_if_there,
)
from stereocal.store.unused import forget_files
from stereocal.writing import write_atomically

STORE_FORMAT = "stereocal-photographs/1"
TABLE_LABEL = "targets found in the photographs"


class ProjectPhotographs:
    """The photographs of one project. Every change is on disk when its method returns."""

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

    def add(self, found: Mapping[str, Path]) -> None:
        """Take over photographs that are stored below `files`; a name given again is replaced.

        Pairs that were edited stay, and new ones are proposed for the others.

        Raises:
            StereocalError: a photograph has gone since it was stored; nothing has changed.
        """
        with self._change() as state:
            flush_stored(found, self.files)
            if not state["files"]:  # of photographs that were removed
                self._forget_found()
            state["files"].update({name: path.name for name, path in found.items()})
            if state["pairs"] is not None:
                kept = [row_of(item) for item in state["pairs"]]
                state["pairs"] = [asdict(row) for row in with_new(kept, list(state["files"]))]

    def clear(self) -> None:
        """Forget all photographs and what was found in them, and free their room."""
        with changing(self.project.folder):
            if not self.folder.exists():
                return
            files: Collection[Path] = ()
            with suppress(StereocalError):  # a list that is damaged is begun anew
                files = self.photographs.values()
            self._file.write(self._file.blank())
            self._forget_found()
            forget_files(self.project.folder, files)

    def give(
        self, files: Mapping[Slot, tuple[str, bytes]], found: Mapping[str, Path], **values: Any
    ) -> None:
        """Give the project a whole data set in place of what it held, in one step or not at all.

        What was found in photographs that are here already stays, with what a person has corrected,
        unless the data set has a table of its own.

        Args:
            files: as of `Project.give`.
            found: photographs that are stored below `files`.
            values: as of `Project.give`.

        Raises:
            StereocalError: it cannot be used, or a photograph has gone; nothing has changed.
        """
        with changing(self.project.folder):
            if found:
                flush_stored(found, self.files)
            names = {name: path.name for name, path in found.items()}
            self._arrive()
            try:
                before = self.photographs
            except DamagedError:  # it is begun anew
                self.project.give(files, ("correspondences",), **values)
                self._forget_found()
                self._file.write({**self._file.blank(), "files": names})
                return
            if before == found and (not found or "correspondences" not in files):
                self._give_again(files, values)
                return
            times = self.project.times_given + 1
            coming = {"times_given": times, "files": names}
            self._file.write({**self._file.read(), "coming": coming})
            try:
                self.project.give(files, ("correspondences",), times, **values)
            finally:
                with suppress(StereocalError):  # the next change does it
                    self._arrive()
            forget_files(self.project.folder, set(before.values()) - set(found.values()))

    def _give_again(
        self, files: Mapping[Slot, tuple[str, bytes]], values: Mapping[str, Any]
    ) -> None:
        """Give a data set whose photographs are here already: the table is of what was found."""
        table: Mapping[Slot, tuple[str, bytes]] = {}
        with suppress(StereocalError):  # nothing was found, or nothing of it is used
            table = self._table(self.frames or [])
        try:
            self.project.give({**files, **table}, drop=("correspondences",), **values)
        except RefusedRowsError as error:  # no rows of the data set: they cannot be left out of it
            raise StereocalError(str(error)) from error

    def _has_come(self, state: Mapping[str, Any]) -> bool:
        """Whether the project has taken over the photographs that are coming."""
        return "coming" in state and bool(
            state["coming"]["times_given"] == self.project.times_given
        )

    def _arrive(self) -> None:
        """Bring the list to what holds, if a server died while photographs were coming."""
        try:
            state = self._file.read()
        except DamagedError:
            return
        if "coming" in state:
            if self._has_come(state):
                self._forget_found()
            self._file.write(self._now(state))

    def _now(self, state: Mapping[str, Any]) -> dict[str, Any]:
        """What holds of a list in which photographs may be coming."""
        if self._has_come(state):
            return {**self._file.blank(), "files": state["coming"]["files"]}
        return {key: value for key, value in state.items() if key != "coming"}

    def _forget_found(self) -> None:
        for name in ("frames.json", "edits.json"):
            forget(self.folder / name)

    def _read(self) -> dict[str, Any]:
        return self._now(self._file.read())

    @contextmanager
    def _change(self) -> Iterator[dict[str, Any]]:
        with changing(self.project.folder):
            self._arrive()
            with self._file.change() as state:
                yield state

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

    @property
    def frames(self) -> list[Frame] | None:
        """What was found and corrected; None before the first search.

        Raises:
            StereocalError: the file is damaged, or of another version.
        """
        with suppress(DamagedError):
            if self._has_come(self._file.read()):
                return None  # those on the disk are of the photographs before
        content = read_if_there(self.folder / "frames.json", "find the targets again")
        return None if content is None else unpack_frames(content)

    def keep_found(self, found: Sequence[Frame], searched: Mapping[str, Path]) -> None:
        """Keep what a search has found; what a person has decided meanwhile stays.

        Args:
            searched: the photographs as they were when the search began.

        Raises:
            StereocalError: as `keep_frames`; or photographs have changed meanwhile, and what was
                found before is unchanged.
        """
        with changing(self.project.folder):
            now, files = self.photographs, {name for frame in found for name in frame.files}
            if any(now.get(name) != searched.get(name) for name in files):
                raise StereocalError(
                    "The photographs were changed while the targets were looked for: find them "
                    "again."
                )
            try:
                before = [frame for frame in self.frames or [] if not self.is_outdated(frame)]
            except StereocalError:  # damaged: the search mends it
                before = []
            with self._change() as state:
                state["searched"] = {name: now[name].name for name in sorted(files & now.keys())}
            self.keep_frames(keep_corrections(found, before))

    def is_outdated(self, frame: Frame) -> bool:
        """Whether a photograph of a frame has been replaced since the targets were found."""
        state = self._read()
        searched = state.get("searched", state["files"])
        return any(state["files"].get(name) != searched.get(name) for name in frame.files)

    def keep_frames(self, frames: Sequence[Frame]) -> None:
        """Keep what was found or corrected, and give the project the table of points of it.

        Raises:
            StereocalError: the points cannot be a table of the project's cameras; the frames are
                kept all the same.
        """
        with changing(self.project.folder):
            self._arrive()
            write_atomically(self.folder / "frames.json", pack_frames(frames))
            self.project.give(self._table(frames))

    def settle(self) -> None:
        """Finish what a server died over, and give the project the table of its frames if it lacks.

        Raises:
            StereocalError: as `keep_frames`.
        """
        if self._is_settled():
            return
        with changing(self.project.folder):
            self._arrive()
            if (frames := self.frames) and not self._is_settled():
                self.project.give(self._table(frames))

    def _is_settled(self) -> bool:
        with suppress(DamagedError):
            if "coming" in self._file.read():
                return False
        frames = self.frames
        if not frames or self.project.inputs.labels.get("correspondences") != TABLE_LABEL:
            return True
        try:
            table = self.project.table
        except StereocalError:  # it has gone
            return False
        return table is not None and table[1] == write_table(correspondences_of(frames))

    @staticmethod
    def _table(frames: Sequence[Frame]) -> dict[Slot, tuple[str, bytes]]:
        return {"correspondences": (TABLE_LABEL, write_table(correspondences_of(frames)))}


def _check(state: dict[str, Any]) -> None:
    _check_files(state["files"])
    if state["pairs"] is not None and not isinstance(state["pairs"], list):
        raise TypeError(state["pairs"])
    for item in state["pairs"] or []:
        row_of(item)
    _check_files(state.get("searched", {}))
    if "coming" in state:
        if not isinstance(state["coming"]["times_given"], int):
            raise TypeError(state["coming"])
        _check_files(state["coming"]["files"])


def _check_files(files: Mapping[Any, Any]) -> None:
    for name, file in files.items():
        if not can_be_shown(name) or not isinstance(file, str):
            raise TypeError(name)
