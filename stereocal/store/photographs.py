"""The photographs of a project on disk: files, pairs, found targets, small pictures.

Below the project's folder, in `photographs/`:

- `files/<digest>.<suffix>`: the photographs as given, never changed once written.
- `photographs.json`: their names and the pairs as the person has edited them.
- `frames.json`: where the targets are (`frames.pack_frames`).
- `thumbnails/`: made when they are first shown.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stereocal.errors import StereocalError, can_be_shown
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.photograph import GreyImage, read_photograph
from stereocal.frames.frame import Frame, correspondences_of, pack_frames, unpack_frames
from stereocal.frames.pairing import Pair, Pairing, pair_names
from stereocal.frames.search import keep_corrections
from stereocal.frames.thumbnails import side_by_side, tile
from stereocal.project import Project
from stereocal.store.folders import own_file
from stereocal.store.state import StateFile, changing, flush_stored, forget, read_if_there
from stereocal.store.unused import forget_files
from stereocal.writing import write_atomically

STORE_FORMAT = "stereocal-photographs/1"
TABLE_LABEL = "targets found in the photographs"


@dataclass(frozen=True)
class PairRow:
    """A pair as the person has it in the table: with the choice to use it."""

    pair: Pair
    use: bool = True


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
        stored: Mapping[str, str] = self._file.read()["files"]
        return {name: own_file(self.files, file) for name, file in stored.items()}

    def add(self, found: Mapping[str, Path]) -> None:
        """Take over photographs that are stored below `files`; a name given again is replaced.

        Pairs that were edited stay, and new ones are proposed for the others.

        Raises:
            StereocalError: a photograph has gone since it was stored; nothing has changed.
        """
        with self._file.change() as state:
            flush_stored(found, self.files)
            if not state["files"]:  # of photographs that were removed
                self._forget_found()
            state["files"].update({name: path.name for name, path in found.items()})
            if state["pairs"] is not None:
                kept = [_row(item) for item in state["pairs"]]
                state["pairs"] = [asdict(row) for row in _with_new(kept, list(state["files"]))]

    def clear(self) -> None:
        """Forget all photographs and what was found in them, and free their room."""
        self.replace({})

    def replace(self, found: Mapping[str, Path], keep_found: bool = False) -> None:
        """Have these photographs, stored below `files`, and no others; free the others' room.

        Args:
            keep_found: if they are those that are here already, what was found in them stays, with
                what a person has corrected.

        Raises:
            StereocalError: a photograph has gone since it was stored; nothing has changed.
        """
        with changing(self.project.folder):
            if not self.folder.exists():
                return
            flush_stored(found, self.files)
            before: Mapping[str, Path] | None = None
            with suppress(StereocalError):  # a list that is damaged is begun anew
                before = self.photographs
            if keep_found and found and before == found:
                if frames := self.frames:
                    self._give_table(frames)
                return
            state = self._file.blank()
            state["files"] = {name: path.name for name, path in found.items()}
            self._file.write(state)
            self._forget_found()
            files = set((before or {}).values()) - set(found.values())
            forget_files(self.project.folder, files)

    def _forget_found(self) -> None:
        for name in ("frames.json", "edits.json"):
            forget(self.folder / name)

    @property
    def proposal(self) -> Pairing:
        """The pairs as the names tell them."""
        return pair_names(self._file.read()["files"])

    @property
    def rows(self) -> list[PairRow]:
        """The pairs as edited, or as proposed while nobody has."""
        edited = self._file.read()["pairs"]
        if edited is None:
            return [PairRow(pair) for pair in self.proposal.pairs]
        return [_row(item) for item in edited]

    def keep_rows(self, rows: Sequence[PairRow] | None) -> None:
        """Keep the pairs as edited; None goes back to the proposal.

        Raises:
            StereocalError: a frame or a photograph stands in two rows, or a name is none.
        """
        with self._file.change() as state:
            if rows is not None:
                check_rows(rows, state["files"])
            state["pairs"] = None if rows is None else [asdict(row) for row in rows]

    def change_rows(self, before: Sequence[PairRow], after: Sequence[PairRow]) -> list[PairRow]:
        """Keep the pairs as edited from `before`; what others have changed since stays.

        Where both have changed the same pair, this edit holds.

        Raises:
            StereocalError: as `keep_rows`.
        """
        with self._file.change() as state:
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
        content = read_if_there(self.folder / "frames.json", "find the targets again")
        return None if content is None else unpack_frames(content)

    def keep_found(self, found: Sequence[Frame]) -> None:
        """Keep what a search has found; what a person has decided meanwhile stays.

        Raises:
            StereocalError: as `keep_frames`.
        """
        with changing(self.project.folder):
            try:
                before = self.frames or []
            except StereocalError:  # damaged: the search mends it
                before = []
            self.keep_frames(keep_corrections(found, before))

    def keep_frames(self, frames: Sequence[Frame]) -> None:
        """Keep what was found or corrected, and give the project the table of points of it.

        Raises:
            StereocalError: the points cannot be a table of the project's cameras; the frames are
                kept all the same.
        """
        with changing(self.project.folder):
            write_atomically(self.folder / "frames.json", pack_frames(frames))
            self._give_table(frames)

    def settle(self) -> None:
        """Give the project the table of its frames, if the server died over it or it has gone.

        Raises:
            StereocalError: as `keep_frames`.
        """
        if self._is_settled():
            return
        with changing(self.project.folder):
            if (frames := self.frames) and not self._is_settled():
                self._give_table(frames)

    def _is_settled(self) -> bool:
        frames = self.frames
        if not frames or self.project.inputs.labels.get("correspondences") != TABLE_LABEL:
            return True
        try:
            table = self.project.table
        except StereocalError:  # it has gone
            return False
        return table is not None and table[1] == write_table(correspondences_of(frames))

    def _give_table(self, frames: Sequence[Frame]) -> None:
        table = write_table(correspondences_of(frames))
        self.project.give({"correspondences": (TABLE_LABEL, table)})

    def thumbnail(self, frame: Frame) -> bytes:
        """A JPEG of both photographs around the targets, made now if it is not there yet."""
        photographs = self.photographs
        paths = [photographs.get(name) for name in frame.files]
        made_of = json.dumps([[p and p.name for p in paths], asdict(frame)["centres"]])
        name = hashlib.sha256(made_of.encode()).hexdigest()[:32]
        path = self.folder / "thumbnails" / f"{name}.jpg"
        if path.is_file():
            return path.read_bytes()
        first, second = (
            tile(_image(path), centres) for path, centres in zip(paths, frame.centres, strict=True)
        )
        content = side_by_side(first, second)
        write_atomically(path, content)
        return content


def check_rows(rows: Sequence[PairRow], names: Mapping[str, Any]) -> None:
    """Refuse a table of pairs that contradicts itself.

    Raises:
        StereocalError: a frame or a photograph stands in two rows, or a name is none.
    """
    frames: set[int] = set()
    taken: set[str] = set()
    for row in rows:
        pair = row.pair
        if pair.frame in frames:
            raise StereocalError(
                f"Frame {pair.frame} stands in two rows: give each its own number."
            )
        frames.add(pair.frame)
        for name in (pair.primary, pair.secondary):
            if name not in names:
                raise StereocalError(f"Frame {pair.frame}: choose a photograph of either camera.")
            if name in taken:
                raise StereocalError(
                    f"Frame {pair.frame}: {name} belongs to another frame or camera already."
                )
            taken.add(name)


def merged(
    before: Sequence[PairRow], after: Sequence[PairRow], now: Sequence[PairRow]
) -> list[PairRow]:
    """The pairs as they are now, with what an edit has made of those before."""
    if list(before) == list(now):
        return list(after)
    added = [row for row in after if row not in before]
    taken = {name for row in added for name in (row.pair.primary, row.pair.secondary)}
    frames = {row.pair.frame for row in added}
    rows = [
        row
        for row in now
        if (row in after or row not in before)
        and row.pair.frame not in frames
        and not {row.pair.primary, row.pair.secondary} & taken
    ]
    return sorted([*rows, *added], key=lambda row: row.pair.frame)


def _with_new(kept: Sequence[PairRow], names: Sequence[str]) -> list[PairRow]:
    """The kept rows, and the proposed pairs of photographs that are in none of them."""
    taken = {name for row in kept for name in (row.pair.primary, row.pair.secondary)}
    frames = {row.pair.frame for row in kept}
    rows = list(kept)
    for pair in pair_names(name for name in names if name not in taken).pairs:
        number = pair.frame if pair.frame not in frames else max(frames) + 1
        frames.add(number)
        rows.append(PairRow(Pair(number, pair.primary, pair.secondary)))
    return rows


def _image(path: Path | None) -> GreyImage | None:
    try:
        return read_photograph(path) if path else None
    except StereocalError:
        return None


def _row(item: Mapping[str, Any]) -> PairRow:
    return PairRow(Pair(**item["pair"]), bool(item["use"]))


def _check(state: dict[str, Any]) -> None:
    for name, file in state["files"].items():
        if not can_be_shown(name) or not isinstance(file, str):
            raise TypeError(name)
    if state["pairs"] is not None and not isinstance(state["pairs"], list):
        raise TypeError(state["pairs"])
    for item in state["pairs"] or []:
        _row(item)
