"""The photographs of the bar in a project: files, pairs, and the targets found in them."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from stereocal.errors import DAMAGED, RefusedRowsError, StereocalError, damaged
from stereocal.frames.all_cameras import pair_folders
from stereocal.frames.decided_pairs import (
    Decided,
    PairRow,
    check_decided,
    check_rows,
    renamed,
    with_new,
)
from stereocal.frames.frame import Frame, correspondences_of, pack_frames, unpack_frames
from stereocal.frames.pairing import Pairing, moments_of
from stereocal.frames.proposal import Choice, Proposal, propose
from stereocal.frames.search import keep_corrections
from stereocal.frames.slips import Slips, find_slips
from stereocal.projects.contents import BAR
from stereocal.projects.database import DamagedError, DiskFullError
from stereocal.projects.files import StoredFile
from stereocal.projects.inputs import Slot
from stereocal.projects.packed import packed_files, packed_table
from stereocal.projects.project import ProjectPart
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair
from stereocal.system.latest import once
from stereocal.system.made_from import Parts
from stereocal.system.records import of_plain, plain
from stereocal.system.taken import Taken, read_taken

TABLE_LABEL = "targets found in the photographs"
BOARDS_LABEL = "corners found in the photographs"
FOUND_LABELS = TABLE_LABEL, BOARDS_LABEL
DAMAGED_PAIRS = "The table of pairs is damaged: remove all photographs, and give them again."
FOUND_IN = "found_by"
"""What the last search was made from; of version 1.0 a digest."""
_TIFF = b"II*\0", b"MM\0*"


class ProjectPhotographs(ProjectPart):
    """The photographs of one project, and the targets found in them."""

    # Photographs and their pairs

    @property
    def photographs(self) -> dict[str, StoredFile]:
        """The photographs by their uploaded names."""
        return self.database.files(BAR)

    @property
    def taken(self) -> dict[str, Taken]:
        """What each photograph's file says, in the order given."""
        return {name: _taken_of(file) for name, file in self.photographs.items()}

    @property
    def proposal(self) -> Proposal:
        """The ways to pair the photographs, and the one taken."""
        choice = self.choice
        stated = [(name, file.about) for name, file in self.photographs.items()]
        return once("pairs proposed", repr((stated, choice)), lambda: propose(self.taken, choice))

    @property
    def choice(self) -> Choice:
        """How to pair, as the user decided it last."""
        return self._decisions[-1].choice

    def choose(self, choice: Choice) -> None:
        """Pair in another way; edited pairs are replaced, until this is undone."""
        with self.database.transaction():
            self._decide([*self._decisions, Decided(choice)])

    @property
    def can_undo_choice(self) -> bool:
        return len(self._decisions) > 1

    def undo_choice(self) -> None:
        """Return to the way and the edited pairs before the last choice."""
        with self.database.transaction():
            self._decide(self._decisions[:-1])

    @property
    def _decisions(self) -> list[Decided]:
        """All in turn, the present one last, with the pairs as edited."""
        with damaged(DAMAGED_PAIRS, DamagedError):
            before = of_plain(self._value("pairing", []), list[Decided]) or [Decided()]
            rows = None if self._edited is None else of_plain(self._edited, list[PairRow])
            return [*before[:-1], replace(before[-1], rows=rows)]

    def check(self) -> None:
        """Raise an error if what was decided or found cannot be used, as in an untrusted file."""
        photographs, _ = self.photographs, self.doubtful_boards
        for decided in self._decisions:
            check_decided(decided, photographs)

    def _decide(self, decisions: Sequence[Decided]) -> None:
        last = decisions[-1] if decisions else Decided()
        self.database.keep_values(BAR, {"pairing": plain(decisions), "pairs": plain(last.rows)})

    @property
    def _edited(self) -> Any:
        return self._value("pairs", None)

    @property
    def rows(self) -> list[PairRow]:
        """The pairs as edited, or as proposed if nobody has edited them."""
        edited = self._decisions[-1].rows
        return [*map(PairRow, self.proposal.pairing.pairs)] if edited is None else edited

    def pairing(self, cameras: Sequence[str] = CAMERAS) -> Pairing:
        """How the photographs belong together: of primary and secondary the pairs in use, of others
        those in their folders; of cameras started by hand, until it is found, what finds it."""
        if tuple(cameras) != CAMERAS:
            return pair_folders(self.taken, cameras, self.choice)
        pairing = self.proposal.pairing
        if pairing.by_hand and self._edited is None:
            return pairing
        used = moments_of(row.pair for row in self.rows if row.use)
        return Pairing(used, sentence=pairing.sentence)

    def paired(self, cameras: Sequence[str]) -> Pairing:
        """How the photographs belong together, as `pairing`.

        Raises:
            StereocalError: none do.
        """
        pairing = self.pairing(cameras)
        if not pairing.moments:
            raise StereocalError(pairing.sentence)
        return pairing

    def settle(self, pairing: Pairing) -> None:
        """Keep what a search found about cameras that were started by hand, if it did."""
        if pairing.motion is not None:
            with self.database.transaction():
                choice = replace(self.choice, later=pairing.motion.later, told=pairing.sentence)
                self._decide([*self._decisions[:-1], Decided(choice)])

    def keep_rows(self, rows: Sequence[PairRow] | None) -> None:
        """Store the edited pairs; None returns to the proposal."""
        with self.database.transaction():
            check_rows(rows or (), self.photographs)
            self.database.keep_values(BAR, {"pairs": plain(rows)})

    def add(self, stored: Mapping[str, StoredFile]) -> None:
        """Add stored photographs; a repeated name is replaced.

        Edited pairs stay, and pairs of the other photographs are proposed. Targets found in
        replaced photographs are removed, also from the table of points.
        """
        with self.database.transaction():
            present = self.photographs
            self.database.name_files(BAR, _dated(stored))
            if self._edited is not None:
                self.keep_rows(with_new(self.rows, self.taken))
            replaced = {name for name in stored if present.get(name, stored[name]) != stored[name]}
            frames = self.frames or []
            remaining = [frame for frame in frames if not replaced.intersection(frame.files)]
            if self.project.inputs.labels.get("correspondences") != TABLE_LABEL:
                self.database.keep_result("frames", pack_frames(remaining))
            elif len(remaining) < len(frames):
                self._keep_frames(remaining)

    def rename(self, names: Mapping[str, str]) -> None:
        """Give photographs other names, by their present ones; their pairs stay."""
        with self.database.transaction():
            files = self.photographs
            moved = {new: files[old] for old, new in names.items() if old in files}
            self.database.name_files(BAR, moved)
            self.database.forget_files(BAR, [old for old in names if old not in moved])
            self._decide([renamed(decision, names) for decision in self._decisions])

    def clear(self, stored: Mapping[str, StoredFile] = MappingProxyType({})) -> None:
        """Delete all photographs but `stored`, and the targets found in them."""
        with self.database.freeing() as db:
            self.database.replace_files(BAR, _dated(stored))
            self.database.keep_values(BAR, {"pairs": None, "pairing": [], FOUND_IN: {}})
            self.database.keep_result("frames", None)
            if not self.database.scope:  # others have no edits
                db.execute("DELETE FROM edit")

    def give(
        self,
        files: Mapping[Slot, tuple[str, bytes]],
        stored: Mapping[str, StoredFile],
        **values: Any,
    ) -> bool:
        """Replace the project's data by a whole data set, in one transaction.

        If the photographs are the same and the data set has no table of its own, the targets found
        and their corrections stay.

        Args:
            files, values: as for `Project.give`.
            stored: its stored photographs.

        Returns:
            Whether the targets found stay.
        """
        with self.database.transaction():
            again = bool(stored) and self.photographs == stored and "correspondences" not in files
            of_frames: dict[Slot, tuple[str, bytes]] = {}
            if again:
                with suppress(StereocalError):  # no target was found, or none is used
                    rows = correspondences_of(self.frames or [])
                    of_frames["correspondences"] = TABLE_LABEL, packed_table(rows)
            self.project.forget_recording()
            try:
                self.project.give({**files, **of_frames}, ("correspondences",), **values)
            except RefusedRowsError as error:
                if not of_frames:
                    raise
                # The rows are not in the data set, so the user cannot leave them out.
                raise StereocalError(str(error)) from error
            if not again:
                self.clear(stored)
        return again

    # What was found

    @property
    def frames(self) -> list[Frame] | None:
        """The targets found and corrected in the present photographs, or None."""
        content = self.database.result("frames")
        return None if content is None else unpack_frames(content) or None

    @property
    def slips(self) -> Slips | None:
        """The photographs without a partner by the targets found, if the present pairs were
        searched and it makes them fit to leave these out."""
        frames, pairs = self.frames or [], [row.pair for row in self.rows if row.use]
        first, second = self.project.cameras
        by_hand = self.proposal.way == "motion"
        if by_hand or first is None or second is None or len(frames) != len(pairs):
            return None
        if any(f.files != (p.primary, p.secondary) for f, p in zip(frames, pairs, strict=True)):
            return None  # paired again since
        key = repr((frames, first.to_json(), second.to_json()))
        return once("slips of photographs", key, lambda: find_slips(frames, (first, second)))

    @property
    def found_in(self) -> Parts:
        """What the last search was made from; empty before it, and after one of version 1.0."""
        parts = self._value(FOUND_IN)
        return parts if isinstance(parts, dict) else {}

    def keep_found_in(self, made_from: Parts) -> None:
        """Store what a search was made from."""
        self.database.keep_values(BAR, {FOUND_IN: {**made_from}})

    def keep_found(
        self, frames: Sequence[Frame], searched: Mapping[str, StoredFile], made_from: Parts
    ) -> None:
        """Store the result of a search; decisions of the user made meanwhile stay.

        Args:
            searched: the photographs when the search began.
            made_from: what else it was made from.

        Raises:
            StereocalError: photographs of these frames have changed meanwhile, and nothing is
                stored; or a frame is to be used and the points do not fit the cameras, and only
                the frames are stored, without a table.
        """
        with self.database.transaction():
            photographs = self.photographs
            names = {name for frame in frames for name in frame.files}
            if any(photographs.get(name) != searched.get(name) for name in names):
                raise StereocalError(
                    "The photographs were changed while the targets were looked for: find them "
                    "again."
                )
            with suppress(StereocalError):  # damaged frames are replaced
                frames = keep_corrections(frames, self.frames or ())
            self.keep_found_in(made_from)
            refused = self._keep_frames(frames)
        # Frames without a target to use are shown as such.
        if refused is not None and any(frame.use and frame.targets_in_both for frame in frames):
            raise refused

    def keep_corrected(self, frames: Sequence[Frame]) -> StereocalError | None:
        """Store corrected frames and their table of points.

        Returns:
            Why the points do not fit the project's cameras: then there is no table.
        """
        with self.database.transaction():
            inputs = self.project.inputs
            refused = self._keep_frames(frames)
            self.project.put_back(inputs.put_back)
            for frame in inputs.left_out:
                self.project.leave_out(frame)
        return refused

    @property
    def boards_found(self) -> str:
        """What the last `keep_boards` stored, in words; empty if that is not in use."""
        label = self.project.inputs.labels.get("correspondences")
        return str(self._value("boards_found")) if label == BOARDS_LABEL else ""

    @property
    def doubtful_boards(self) -> dict[int, str]:
        """Why the board of a frame is not used or does not fit well, by frame."""
        return {int(frame): str(why) for frame, why in self._value("boards_doubtful", {}).items()}

    def keep_boards(
        self,
        dataset: Pair,
        sentence: str,
        doubtful: Mapping[int, str],
        lenses: str | None,
        made_from: Parts,
    ) -> None:
        """Store the corners of a board as the table of points.

        A baseline that was not measured is free: the squares give the scale.

        Args:
            sentence: what was found, in words.
            doubtful: reasons by frame.
            lenses: the label of the data set's lenses, which replace those of the project; None
                to keep those.
            made_from: what the search was made from.
        """
        labels: dict[Slot, str] = {"correspondences": BOARDS_LABEL}
        if lenses is not None:
            labels |= dict.fromkeys(CAMERAS, lenses)
        packed = packed_files(dataset)
        files = {slot: (label, packed[slot]) for slot, label in labels.items()}
        values: dict[str, Any] = {"target_distance_m": dataset.target_distance_m}
        why = {str(frame): why for frame, why in doubtful.items()}
        board_values = {"boards_found": sentence, "boards_doubtful": why}
        with self.database.transaction():
            if self.project.inputs.baseline_m is None:
                values["baseline_free"] = True
            self.project.give(files, **values)
            self.database.keep_values(BAR, board_values)
            self.keep_found_in(made_from)
            self.database.keep_result("frames", None)

    def _keep_frames(self, frames: Sequence[Frame]) -> StereocalError | None:
        with self.database.transaction():
            self.database.keep_result("frames", pack_frames(frames))
            try:
                table = packed_table(correspondences_of(frames))
                self.project.give({"correspondences": (TABLE_LABEL, table)})
            except DiskFullError:
                raise
            except StereocalError as error:
                self.project.give({}, ("correspondences",))
                return error
        return None

    def _value(self, name: str, default: Any = "") -> Any:
        value = self.database.values(BAR).get(name)
        return default if value is None else value


def _taken_of(file: StoredFile) -> Taken:
    """What was stored with a photograph's name; earlier versions stored its name only."""
    with suppress(*DAMAGED):
        return of_plain(file.about, Taken) if isinstance(file.about, dict) else Taken()
    return Taken()


def _dated(stored: Mapping[str, StoredFile]) -> dict[str, StoredFile]:
    """Photographs with what their files say, to be stored with their names."""
    return {
        name: file
        if isinstance(file.about, dict)
        else replace(file, about=plain(read_taken(_head(file), name)))
        for name, file in stored.items()
    }


def _head(file: StoredFile) -> bytes:
    """A photograph as far as its header goes: a TIFF may have it at the end."""
    with suppress(StereocalError):  # reported where the photograph is used
        head = next(file.pieces(), b"")
        return file.read_bytes() if head[:4] in _TIFF else head
    return b""
