"""The photographs of the bar in a project: files, pairs, and what was found in them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from typing import Any

from stereocal.errors import DAMAGED, RefusedRowsError, StereocalError
from stereocal.formats.correspondences_csv import write_table
from stereocal.frames.frame import Frame, correspondences_of, pack_frames, unpack_frames
from stereocal.frames.pairing import Pairing, pair_names
from stereocal.frames.search import keep_corrections
from stereocal.projects.files import (
    StoredFile,
    files_of,
    forget_files,
    keep_file,
    keep_result,
    keep_values,
    name_files,
    put_files,
    result_of,
    values_of,
)
from stereocal.projects.inputs import Slot
from stereocal.projects.pair_rows import PairRow, check_rows, row_of, with_new
from stereocal.projects.project import Project
from stereocal.projects.refusals import DamagedError, FullError

BAR = "bar"
TABLE_LABEL = "targets found in the photographs"


class ProjectPhotographs:
    """The photographs of one project, and what was found in them.

    Every change is on disk when its method returns.
    """

    def __init__(self, project: Project) -> None:
        self.project = project
        self.database = project.database

    # Photographs and their pairs

    def keep(self, name: str, content: bytes) -> StoredFile:
        """Store a photograph, which is the project's once it is added or given.

        Raises:
            StereocalError: the project would be too large, or the disk is full.
        """
        return keep_file(self.database, content, name)

    @property
    def photographs(self) -> dict[str, StoredFile]:
        """Files by the person's names."""
        return files_of(self.database, BAR)

    @property
    def proposal(self) -> Pairing:
        """The pairs as the names tell them."""
        return pair_names(self.photographs)

    @property
    def rows(self) -> list[PairRow]:
        """The pairs as edited, or as proposed while nobody has."""
        edited = self._value("pairs")
        if edited is None:
            return [PairRow(pair) for pair in self.proposal.pairs]
        try:
            return [row_of(item) for item in edited]
        except DAMAGED as error:
            raise DamagedError(
                "The table of pairs is damaged: remove all photographs, and give them again."
            ) from error

    def keep_rows(self, rows: Sequence[PairRow] | None) -> None:
        """Keep the pairs as edited; None goes back to the proposal.

        Raises:
            StereocalError: a frame or a photograph stands in two rows, or a name is none.
        """
        with self.database.act():
            if rows is not None:
                check_rows(rows, self.photographs)
            kept = None if rows is None else [asdict(row) for row in rows]
            keep_values(self.database, BAR, {"pairs": kept})

    def add(self, found: Mapping[str, StoredFile]) -> None:
        """Take over stored photographs; a name given again is replaced.

        Pairs that were edited stay, and new ones are proposed for the others. What was found in
        photographs that are replaced goes, from the table of points too.

        Raises:
            StereocalError: a photograph has gone since it was stored; nothing has changed.
        """
        with self.database.act():
            before = self.photographs
            name_files(self.database, BAR, found)
            if self._value("pairs") is not None:
                self.keep_rows(with_new(self.rows, list(self.photographs)))
            replaced = {name for name in found if before.get(name, found[name]) != found[name]}
            frames = self.frames or []
            left = [frame for frame in frames if not replaced.intersection(frame.files)]
            if self.project.inputs.labels.get("correspondences") != TABLE_LABEL:
                keep_result(self.database, "frames", pack_frames(left))
            elif len(left) < len(frames):
                self._keep_frames(left)

    def clear(self) -> None:
        """Forget all photographs and what was found in them, and free their room."""
        self.database.free(lambda _db: self._forget())

    def _forget(self) -> None:
        forget_files(self.database, BAR)
        keep_values(self.database, BAR, {"pairs": None, "found_by": ""})
        self._forget_found()

    def _forget_found(self) -> None:
        with self.database.act() as db:
            keep_result(self.database, "frames", None)
            db.execute("DELETE FROM edit")

    def give(
        self,
        files: Mapping[Slot, tuple[str, bytes]],
        found: Mapping[str, StoredFile],
        **values: Any,
    ) -> bool:
        """Give the project a whole data set in place of what it held, in one step or not at all.

        What was found in photographs that are here already stays, with what a person has corrected,
        unless the data set has a table of its own.

        Args:
            files: as of `Project.give`.
            found: its photographs, which are stored.
            values: as of `Project.give`.

        Returns:
            Whether what was found stays.

        Raises:
            StereocalError: it cannot be used, or a photograph has gone; nothing has changed.
        """
        with self.database.act():
            again = bool(found) and self.photographs == found and "correspondences" not in files
            table: Mapping[Slot, tuple[str, bytes]] = {}
            if again:
                with suppress(StereocalError):  # nothing was found, or nothing of it is used
                    table = _table(self.frames or [])
            try:
                self.project.give({**files, **table}, ("correspondences",), **values)
            except RefusedRowsError as error:
                if not table:
                    raise
                # Rows that are none of the data set: they cannot be left out of it.
                raise StereocalError(str(error)) from error
            if not again:
                put_files(self.database, BAR, found)
                keep_values(self.database, BAR, {"pairs": None, "found_by": ""})
                self._forget_found()
        return again

    # What was found

    @property
    def frames(self) -> list[Frame] | None:
        """What was found and corrected in the photographs that are there now, or None.

        Raises:
            StereocalError: it is damaged, or of another version.
        """
        content = result_of(self.database, "frames")
        return (unpack_frames(content) or None) if content is not None else None

    @property
    def found_by(self) -> str:
        """Which search has found what is there, as `keep_found` was told; empty if none."""
        return str(self._value("found_by") or "")

    def keep_found(
        self, found: Sequence[Frame], searched: Mapping[str, StoredFile], search: str = ""
    ) -> None:
        """Keep what a search has found; what a person has decided meanwhile stays.

        Args:
            searched: the photographs as they were when the search began.
            search: tells searches apart that may find something else.

        Raises:
            StereocalError: as `keep_frames`; or photographs have changed meanwhile, and what was
                found before is unchanged.
        """
        refused = None
        with self.database.act():
            now, names = self.photographs, {name for frame in found for name in frame.files}
            if any(now.get(name) != searched.get(name) for name in names):
                raise StereocalError(
                    "The photographs were changed while the targets were looked for: find them "
                    "again."
                )
            before: Sequence[Frame] = ()
            with suppress(StereocalError):  # damaged: the search mends it
                before = self.frames or ()
            keep_values(self.database, BAR, {"found_by": search})
            refused = self._keep_frames(keep_corrections(found, before))
        if refused is not None:
            raise refused

    def keep_frames(self, frames: Sequence[Frame]) -> None:
        """Keep what was found or corrected, and give the project the table of points of it.

        Raises:
            StereocalError: the points cannot be a table of the project's cameras, and the project
                has none; the frames are kept all the same.
        """
        if (refused := self.keep_corrected(frames)) is not None:
            raise refused

    def keep_corrected(self, frames: Sequence[Frame]) -> StereocalError | None:
        """As `keep_frames`; why the frames give no table. Frames that were put back stay so."""
        with self.database.act():
            put_back = self.project.inputs.put_back
            refused = self._keep_frames(frames)
            self.project.put_back(put_back)
        return refused

    def _keep_frames(self, frames: Sequence[Frame]) -> StereocalError | None:
        with self.database.act():
            keep_result(self.database, "frames", pack_frames(frames))
            try:
                self.project.give(_table(frames))
            except FullError:
                raise
            except StereocalError as error:
                self.project.give({}, ("correspondences",))
                return error
        return None

    def _value(self, name: str) -> Any:
        return values_of(self.database, BAR).get(name)


def kept(
    photographs: Iterable[tuple[str, bytes]], store: ProjectPhotographs
) -> dict[str, StoredFile]:
    """Store photographs one by one, name and content; they are the project's once they are added.

    Raises:
        StereocalError: as `ProjectPhotographs.keep`.
    """
    return {name: store.keep(name, content) for name, content in photographs}


def _table(frames: Sequence[Frame]) -> dict[Slot, tuple[str, bytes]]:
    return {"correspondences": (TABLE_LABEL, write_table(correspondences_of(frames)))}
