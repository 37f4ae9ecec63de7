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
import threading
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from stereocal.errors import StereocalError
from stereocal.formats.correspondences_csv import write_table
from stereocal.formats.photograph import GreyImage, read_photograph
from stereocal.frames.frame import Frame, correspondences_of, pack_frames, unpack_frames
from stereocal.frames.pairing import Pair, Pairing, pair_names
from stereocal.frames.thumbnails import side_by_side, tile
from stereocal.project import Project
from stereocal.store.folders import own_file
from stereocal.writing import write_atomically

STORE_FORMAT = "stereocal-photographs/1"
TABLE_LABEL = "targets found in the photographs"
_WRITING = threading.Lock()


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

    @property
    def photographs(self) -> dict[str, Path]:
        """Files on disk by the person's names."""
        stored: Mapping[str, str] = self._read()["files"]
        return {name: own_file(self.files, file) for name, file in stored.items()}

    def add(self, found: Mapping[str, Path]) -> None:
        """Take over photographs that are stored below `files`; a name given again is replaced.

        Pairs that were edited stay, and new ones are proposed for the others.
        """
        with _WRITING:
            state = self._read()
            state["files"].update({name: path.name for name, path in found.items()})
            if state["pairs"] is not None:
                kept = [_row(item) for item in state["pairs"]]
                state["pairs"] = [asdict(row) for row in _with_new(kept, list(state["files"]))]
            self._write(state)

    def clear(self) -> None:
        """Forget all photographs and what was found in them; the files stay on disk."""
        with _WRITING:
            self._write(_empty())
            (self.folder / "frames.json").unlink(missing_ok=True)

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
        return [_row(item) for item in edited]

    def keep_rows(self, rows: Sequence[PairRow] | None) -> None:
        """Keep the pairs as edited; None goes back to the proposal.

        Raises:
            StereocalError: a frame or a photograph stands in two rows, or a name is none.
        """
        with _WRITING:
            state = self._read()
            if rows is not None:
                check_rows(rows, state["files"])
            state["pairs"] = None if rows is None else [asdict(row) for row in rows]
            self._write(state)

    @property
    def frames(self) -> list[Frame] | None:
        """What was found and corrected; None before the first search."""
        path = self.folder / "frames.json"
        return unpack_frames(path.read_bytes()) if path.is_file() else None

    def keep_frames(self, frames: Sequence[Frame]) -> None:
        """Keep what was found or corrected, and give the project the table of points of it.

        Raises:
            StereocalError: the points cannot be a table of the project's cameras; the frames are
                kept all the same.
        """
        write_atomically(self.folder / "frames.json", pack_frames(frames))
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

    def _read(self) -> dict[str, Any]:
        path = self.folder / "photographs.json"
        if not path.is_file():
            return _empty()
        try:
            state: dict[str, Any] = json.loads(path.read_bytes())
        except (OSError, ValueError) as error:
            raise StereocalError(f"The list of photographs cannot be read ({error}).") from error
        if state.get("format") != STORE_FORMAT:
            raise StereocalError("The photographs were stored by another version of stereocal.")
        return state

    def _write(self, state: Mapping[str, Any]) -> None:
        write_atomically(self.folder / "photographs.json", json.dumps(state, indent=1).encode())


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


def _empty() -> dict[str, Any]:
    return {"format": STORE_FORMAT, "files": {}, "pairs": None}


def _row(item: Mapping[str, Any]) -> PairRow:
    return PairRow(Pair(**item["pair"]), bool(item["use"]))
