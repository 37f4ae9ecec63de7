"""The photographs of a project on disk: files, pairs, found targets, small pictures.

Below the project's folder, in `photographs/`:

- `files/<digest>.<suffix>`: the photographs as given, never changed once written.
- `photographs.json`: their names and the pairs (`photograph_list`).
- `frames.json`: where the targets are (`frames.pack_frames`).
- `thumbnails/`: made when they are first shown.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from stereocal.errors import RefusedRowsError, StereocalError
from stereocal.formats.correspondences_csv import write_table
from stereocal.frames.frame import Frame, correspondences_of, pack_frames, unpack_frames
from stereocal.frames.search import keep_corrections
from stereocal.inputs import Slot
from stereocal.store.pair_rows import row_of, with_new
from stereocal.store.photograph_list import PhotographList
from stereocal.store.state import DamagedError, changing, flush_stored, read_if_there
from stereocal.store.unused import forget_files
from stereocal.system.atomic_files import write_atomically

TABLE_LABEL = "targets found in the photographs"


class ProjectPhotographs(PhotographList):
    """The photographs of one project, and what was found in them.

    Every change is on disk when its method returns.
    """

    def add(self, found: Mapping[str, Path]) -> None:
        """Take over photographs that are stored below `files`; a name given again is replaced.

        Pairs that were edited stay, and new ones are proposed for the others. What was found in
        photographs that are replaced goes, from the table of points too.

        Raises:
            StereocalError: a photograph has gone since it was stored; nothing has changed.
        """
        with self._change() as state:
            flush_stored(found, self.files)
            if not state["files"]:  # of photographs that were removed
                self._forget_found()
            files, before = state["files"], dict(state["files"])
            files.update({name: path.name for name, path in found.items()})
            replaced = {name for name in before if files[name] != before[name]}
            state["outdated"] = sorted(replaced.union(state.get("outdated", ())))
            if state["pairs"] is not None:
                kept = [row_of(item) for item in state["pairs"]]
                state["pairs"] = [asdict(row) for row in with_new(kept, list(files))]
        if replaced:
            with suppress(StereocalError):  # the page of the photographs says it
                self.settle()

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
    ) -> bool:
        """Give the project a whole data set in place of what it held, in one step or not at all.

        What was found in photographs that are here already stays, with what a person has corrected,
        unless the data set has a table of its own.

        Args:
            files: as of `Project.give`.
            found: photographs that are stored below `files`.
            values: as of `Project.give`.

        Returns:
            Whether what was found stays.

        Raises:
            StereocalError: it cannot be used, or a photograph has gone; nothing has changed.
        """
        before = None
        with suppress(DamagedError):  # a list that is damaged is begun anew
            before = self.photographs
        again = bool(found) and before == found and "correspondences" not in files
        table: Mapping[Slot, tuple[str, bytes]] = {}
        if again:
            with suppress(StereocalError):  # nothing was found, or nothing of it is used
                table = self._table(self.frames or [])
        try:
            self.project.give(
                {**files, **table},
                ("correspondences",),
                lambda state: self._coming(state, before, found, again),
                **values,
            )
        except RefusedRowsError as error:
            if not table:
                raise
            # Rows that are none of the data set: they cannot be left out of it.
            raise StereocalError(str(error)) from error
        if before and not again:
            forget_files(self.project.folder, set(before.values()) - set(found.values()))
        return again

    @contextmanager
    def _coming(
        self,
        project: dict[str, Any],
        before: Mapping[str, Path] | None,
        found: Mapping[str, Path],
        again: bool,
    ) -> Iterator[None]:
        """Have photographs in place of those before as soon as the project's state is written."""
        if found:
            flush_stored(found, self.files)
        names = {name: path.name for name, path in found.items()}
        if before is None:
            yield
            self._forget_found()
            self._file.write({**self._file.blank(), "files": names})
            return
        self._arrive()
        if self.photographs != before:
            raise StereocalError("The photographs were changed meanwhile: give the data set again.")
        if again or not (before or found):
            yield
            return
        with self._announced(names, project):
            yield

    @property
    def frames(self) -> list[Frame] | None:
        """What was found and corrected in the photographs that are there now, or None.

        Raises:
            StereocalError: the file is damaged, or of another version.
        """
        state: Mapping[str, Any] = {}
        with suppress(DamagedError):  # what was found can be read without the list
            state = self._file.read()
            if self._has_come(state) or not state["files"]:
                return None  # those on the disk are of photographs that have gone
        content = read_if_there(self.folder / "frames.json", "find the targets again")
        if content is None:
            return None
        outdated = state.get("outdated", ())
        return [
            frame for frame in unpack_frames(content) if not set(frame.files).intersection(outdated)
        ] or None

    @property
    def found_by(self) -> str:
        """Which search has found what is there, as `keep_found` was told; empty if none."""
        return str(self._read().get("found_by", ""))

    def keep_found(
        self, found: Sequence[Frame], searched: Mapping[str, Path], search: str = ""
    ) -> None:
        """Keep what a search has found; what a person has decided meanwhile stays.

        Args:
            searched: the photographs as they were when the search began.
            search: tells searches apart that may find something else.

        Raises:
            StereocalError: as `keep_frames`; or photographs have changed meanwhile, and what was
                found before is unchanged.
        """
        with changing(self.project.folder):
            now, names = self.photographs, {name for frame in found for name in frame.files}
            if any(now.get(name) != searched.get(name) for name in names):
                raise StereocalError(
                    "The photographs were changed while the targets were looked for: find them "
                    "again."
                )
            try:
                before = self.frames or []
            except StereocalError:  # damaged: the search mends it
                before = []
            kept = keep_corrections(found, before)
            self._write_frames(kept)
            # After them: a server that dies in between has the targets looked for once more.
            with self._change() as state:
                state.pop("outdated", None)
                state["found_by"] = search
            self.project.give(self._table(kept))

    def keep_frames(self, frames: Sequence[Frame]) -> None:
        """Keep what was found or corrected, and give the project the table of points of it.

        Raises:
            StereocalError: the points cannot be a table of the project's cameras; the frames are
                kept all the same.
        """
        with changing(self.project.folder):
            self._write_frames(frames)
            self.project.give(self._table(frames))

    def _write_frames(self, frames: Sequence[Frame]) -> None:
        self._arrive()
        write_atomically(self.folder / "frames.json", pack_frames(frames))

    def settle(self) -> None:
        """Finish what a server died over, and have the project's table be that of its frames.

        Where they give no table, the project has none.

        Raises:
            StereocalError: as `keep_frames`.
        """
        if self._is_settled():
            return
        with changing(self.project.folder):
            self._arrive()
            if self._is_settled():
                return
            try:
                table = self._table(self.frames or [])
            except StereocalError:
                self.project.give({}, drop=("correspondences",))
            else:
                self.project.give(table)

    def _is_settled(self) -> bool:
        state: Mapping[str, Any] = {}
        with suppress(DamagedError):
            state = self._file.read()
        if "coming" in state:
            return False
        frames = self.frames
        removed = frames is None and not state.get("outdated")
        if removed or self.project.inputs.labels.get("correspondences") != TABLE_LABEL:
            return True
        try:
            table = self.project.table
            return table is not None and table == self._table(frames or [])["correspondences"]
        except StereocalError:  # it has gone, or the frames give none
            return False

    @staticmethod
    def _table(frames: Sequence[Frame]) -> dict[Slot, tuple[str, bytes]]:
        return {"correspondences": (TABLE_LABEL, write_table(correspondences_of(frames)))}
