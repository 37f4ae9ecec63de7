"""The targets, or the boards, in the photographs of all cameras: of scripts and of commands."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from stereocal.detection.target import Board, Target, parse_board, parse_target
from stereocal.errors import StereocalError
from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.dataset_description import DESCRIPTION
from stereocal.formats.dataset_files import read_recording, read_texts
from stereocal.frames.all_cameras import Found, pair_folders
from stereocal.frames.frame import Frame, correspondences_of, report_line
from stereocal.frames.pairing import Pairing
from stereocal.frames.proposal import Choice, Way, propose
from stereocal.frames.slips import find_slips
from stereocal.intrinsics.held_object import held_object
from stereocal.intrinsics.photograph_search import PhotographSearch
from stereocal.intrinsics.proposed_board import ProposedBoard, proposed_board
from stereocal.library.calibrations import recording_of
from stereocal.library.drawing import draw
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.pair import Pair
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.answers import TableAnswer
from stereocal.system.arguments import checked
from stereocal.system.executors import engine
from stereocal.system.photograph_files import Photographs, of_the_bar, photographs_in
from stereocal.system.split_photographs import Split, split_by_shape, split_into
from stereocal.system.taken import when_taken
from stereocal.system.tasks import Progress

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False, repr=False)
class FoundTargets(TableAnswer):
    """The targets, or the boards, in the photographs of all cameras."""

    recording: Pair | Recording
    """To calibrate from."""
    sentences: list[str]
    frames: list[Frame] = field(default_factory=list)
    """What was found of a bar in two cameras, doubtful ones too, which are not used."""

    @property
    def answer(self) -> list[str]:
        doubts = [report_line(frame) for frame in self.frames if frame.state != "found"]
        return [*self.sentences, *doubts]

    def to_dataframe(self) -> pd.DataFrame:
        """The table of points."""
        return self.recording.to_dataframe()

    @checked
    def plot(self, pair: CameraPair | None = None) -> go.Figure:
        """Where the points lie in the images of two cameras: of the first pair, or of one."""
        recording = recording_of(self.recording)
        return draw("coverage.plot_coverage", recording.pair(*(pair or recording.pairs[0])))


@checked
def detect(
    path: str | Path,
    target: str = "bar2x2",
    pair_by: Way | None = None,
    lens_model: LensModel | None = None,
) -> FoundTargets:
    """Find the targets in the photographs of a data set.

    Args:
        path: a folder or zip with dataset.json and photographs; of a board it may be without
            dataset.json: then the same photographs give the lenses, and the board the scale.
        target: what is held, as of the command: "bar2x2", "balls:red,yellow", "tags:4X4_50:3,7",
            "board:9x6:0.03" and so on.
        pair_by: how photographs belong together; None: by name, by the time taken, or in order.

    Raises:
        StereocalError: no targets are found, or no way to pair the photographs is sure.
    """
    messages = list[str]()
    with engine() as workers:
        search = DataSetSearch(Path(path), workers, messages.append, pair_by, lens_model)
        targets = search.found(parse_board(target) or parse_target(target))
        if not targets.frames:
            return FoundTargets(search.recording(targets), messages)
        recording = search.known.with_pairs(correspondences_of(targets.frames))
        found = recording if recording.has_windows else pair_to_calibrate(recording)
        return FoundTargets(found, messages, targets.frames)


@dataclass(frozen=True)
class DataSetSearch:
    """The photographs in a folder or zip, and how they are searched."""

    path: Path
    workers: Executor
    tell: Callable[[str], object]
    """Called with what was found, a sentence each time."""
    way: Way | None = None
    lens_model: LensModel | None = None
    split: Split | None = None
    """How the images of two cameras lie in each photograph."""
    heard: Mapping[str, float] = field(default_factory=dict)
    """The offsets that the sound tells, as of `ByHand`."""

    @cached_property
    def known(self) -> Recording:
        """The cameras and lengths of the data set, without points."""
        return read_recording(self.path, self.lens_model, with_points=False)

    @cached_property
    def cameras(self) -> Sequence[str]:
        """Names of the folders of photographs; for two cameras primary and secondary."""
        several = self.is_described and len(self.known.cameras) > 2
        return [*self.known.cameras] if several else CAMERAS

    @cached_property
    def is_described(self) -> bool:
        """Whether there is a `dataset.json`."""
        texts = read_texts(self.path)[0] if self.path.exists() else ()
        return any(PurePath(name).name == DESCRIPTION for name in texts)

    def found(
        self,
        target: Target | Board,
        begin: Callable[[str], None] = lambda _: None,
        progress: Progress = lambda *_: None,
    ) -> Found:
        """What is held, in all photographs. The lenses are those of the data set; of boards without
        one, they come from the same photographs."""
        is_board = isinstance(target, Board)
        lenses: Mapping[str, Camera | None] = dict.fromkeys(self.cameras)
        if self.is_described or not is_board:
            lenses = dict(zip(self.cameras, self.known.cameras.values(), strict=True))
        with tempfile.TemporaryDirectory(prefix="stereocal-") as store:
            begin("photographs unpacked")
            photographs = of_the_bar(photographs_in(self.path, Path(store), progress))
            if self.split is not None:
                photographs = split_into(Path(store), photographs, self.split)
            pairing = self._pairing(photographs)
            if len(self.cameras) == 2 and not is_board:
                self.tell(f"{len(photographs)} photographs. {pairing.sentence}")
            held = self._held(target, photographs, pairing)
            search = PhotographSearch(pairing, photographs, lenses, held)
            targets = search.run(self.workers, begin, progress, tell=self.tell)
        if targets.frames and not targets.pairing.motion:
            first, second = targets.cameras.values()
            if (slips := find_slips(targets.frames, (first, second))) is not None:
                words = f"{slips} Take {slips.it} out of the folder, and find the targets again."
                if not any(frame.use for frame in targets.frames):
                    raise StereocalError(f"{self.path}: {words}")
                self.tell(words)
        return targets

    def recording(self, targets: Found) -> Recording:
        """What was found, with the cameras and lengths of the data set, if there is one."""
        if not self.is_described:
            return replace(targets.recording, name=self.path.stem)
        names = ("name", "cameras", "baselines_m", "baseline_sigma_m", "notes", "windows")
        stated = {name: getattr(self.known, name) for name in names}
        if targets.object.board is None:
            stated["object"] = self.known.object
        return replace(targets.recording, **stated)

    def _pairing(self, photographs: Mapping[str, Path]) -> Pairing:
        """How the photographs belong together.

        Raises:
            StereocalError: there are no pairs in the way chosen; or, if none is, no way is sure.
        """
        taken, choice, way = when_taken(photographs), Choice(self.way, heard=self.heard), self.way
        if len(self.cameras) > 2:
            if way not in (None, "motion"):
                raise StereocalError(
                    f"--pair-by {way} is for two cameras. The photographs of more belong together "
                    "by their names or the time taken; or by the motion (--pair-by motion)."
                )
            return pair_folders(taken, self.cameras, choice)
        proposal = propose(taken, choice)
        pairing = proposal.pairing
        unsure = "" if pairing.moments else pairing.sentence
        if way is not None and proposal.way != way:
            unsure = f"no two photographs can be paired by --pair-by {way}."
        elif pairing.moments and pairing.ambiguous and way is None:
            ways = " or ".join(f"--pair-by {way}" for way in proposal.ways)
            unsure = f"{pairing.sentence} Or state how to pair them: {ways}."
        sizes = {one.size for one in taken.values() if one.size}
        if unsure and {*map(split_by_shape, sizes)} == {"side-by-side"}:
            unsure += " If each holds the images of both cameras, state --split side-by-side."
        if unsure:
            raise StereocalError(f"{self.path}: {unsure}")
        return pairing

    def _held(
        self, target: Target | Board, photographs: Photographs, pairing: Pairing
    ) -> Target | BoardPattern:
        """Where the size of a board is not stated, it is that of the board that moves before the
        cameras, or else that most show."""
        if not isinstance(target, Board):
            return target
        if target.size:
            return target.pattern()
        names = pairing.names(self.cameras).values()
        held = held_object([{name: photographs[name] for name in side} for side in names])
        board = held.what if held is not None else None
        if not isinstance(board, ProposedBoard):
            board = proposed_board(photographs)
        if board is None:
            raise StereocalError(
                "The size of the board cannot be found in the first photographs: count the inner "
                "corners, where four squares meet, and state them, as board:9x6:0.03."
            )
        self.tell(
            f"The board has {board} inner corners, as the first photographs show; else state them."
        )
        return target.pattern(str(board))
