"""The targets, or the boards, in the photographs of all cameras: of scripts and of commands."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path, PurePath
from typing import TYPE_CHECKING

from stereocal.detection.target import Board, Target, parse_board, parse_target
from stereocal.errors import StereocalError
from stereocal.formats.dataset_description import DESCRIPTION
from stereocal.formats.dataset_files import read_recording, read_texts
from stereocal.frames.all_cameras import by_folder, match_names
from stereocal.frames.frame import Frame, correspondences_of, describe_frames, report_line
from stereocal.frames.pairing import ByHand, Moments, Pairing, names_by_camera, natural
from stereocal.frames.proposal import Choice, Way, by_hand_of, propose
from stereocal.frames.search import detect_frames
from stereocal.frames.slips import find_slip
from stereocal.intrinsics.held_object import held_object
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.intrinsics.proposed_board import ProposedBoard, proposed_board
from stereocal.intrinsics.quality import lens_answer, note_on_model
from stereocal.intrinsics.stereo_boards import find_stereo_boards, lenses_of_boards, recording_of
from stereocal.library.drawing import draw
from stereocal.network.to_calibrate import pair_to_calibrate
from stereocal.rig.camera import CAMERAS, Camera, LensModel
from stereocal.rig.dataset import Dataset
from stereocal.rig.field_of_view import beyond_in_words
from stereocal.rig.recording import CameraPair, Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.answers import TableAnswer
from stereocal.system.executors import engine
from stereocal.system.photograph_files import Photographs, of_the_bar, photographs_in
from stereocal.system.taken import when_taken
from stereocal.system.tasks import Progress

if TYPE_CHECKING:
    import pandas as pd
    import plotly.graph_objects as go


@dataclass(frozen=True, eq=False, repr=False)
class FoundTargets(TableAnswer):
    """The targets, or the boards, in the photographs of all cameras."""

    recording: Dataset | Recording
    """To calibrate from."""
    sentences: list[str]
    frames: list[Frame] = field(default_factory=list)
    """Of a bar and two cameras: what was found, doubtful ones too, which are not used."""

    @property
    def answer(self) -> list[str]:
        doubts = [report_line(frame) for frame in self.frames if frame.state != "found"]
        return [*self.sentences, *doubts]

    def to_dataframe(self) -> pd.DataFrame:
        """The table of points."""
        return self.recording.to_dataframe()

    def plot(self, pair: CameraPair | None = None) -> go.Figure:
        """Where the points lie in the images of two cameras: of the first pair, or of one."""
        found = self.recording
        if isinstance(found, Recording):
            found = found.pair(*(pair or found.pairs[0]))
        return draw("coverage.plot_coverage", found)


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
    told = list[str]()
    with engine() as workers:
        search = PhotographSearch(Path(path), workers, told.append, pair_by, lens_model)
        frames = search.found(parse_board(target) or parse_target(target))
        if isinstance(frames, Recording):
            return FoundTargets(frames, told)
        found = search.known.with_pairs(correspondences_of(frames))
        return FoundTargets(pair_to_calibrate(found), told, frames)


def _silent(*_: object) -> None:
    """Progress that nobody looks at."""


@dataclass(frozen=True)
class PhotographSearch:
    """The photographs in a folder or zip, and how they are searched."""

    path: Path
    workers: Executor
    tell: Callable[[str], object]
    """Called with what was found, a sentence each time."""
    way: Way | None = None
    lens_model: LensModel | None = None
    heard: Mapping[str, float] = field(default_factory=dict)
    """As in `ByHand`."""
    begin: Callable[[str], None] = _silent
    progress: Progress = _silent

    @cached_property
    def known(self) -> Recording:
        """The cameras and lengths of the data set, without points."""
        return read_recording(self.path, self.lens_model, with_points=False)

    @cached_property
    def cameras(self) -> Sequence[str]:
        """By which folders of photographs are called; of two cameras primary and secondary."""
        several = self.is_described and len(self.known.cameras) > 2
        return [*self.known.cameras] if several else CAMERAS

    @cached_property
    def lenses(self) -> dict[str, Camera]:
        """By the names in `cameras`."""
        return dict(zip(self.cameras, self.known.cameras.values(), strict=True))

    @cached_property
    def is_described(self) -> bool:
        """Whether there is a `dataset.json`."""
        texts = read_texts(self.path)[0] if self.path.exists() else ()
        return any(PurePath(name).name == DESCRIPTION for name in texts)

    def found(self, target: Target | Board) -> list[Frame] | Recording:
        """What is on the bar in all frames; of boards, or of more than two cameras, points."""
        if len(self.cameras) > 2:
            return self._in_all_cameras(target)
        return self._boards(target) if isinstance(target, Board) else self._frames(target)

    def _in_all_cameras(self, target: Target | Board) -> Recording:
        if self.way not in (None, "motion"):
            raise StereocalError(
                f"--pair-by {self.way} is for two cameras. The photographs of more belong together "
                "by their names or the time taken; or by the motion (--pair-by motion)."
            )
        with self._photographs() as photographs:
            folders = by_folder(sorted(photographs, key=natural), self.cameras)
            moments: Moments | ByHand = by_hand_of(folders, self.heard)
            if self.way is None:
                moments = match_names(folders, when_taken(photographs))
            about = moments, photographs, self.lenses
            control = self.workers, self.begin, self.progress
            if isinstance(target, Board):
                pattern = self._pattern(target, photographs, moments)
                found = recording_of(find_stereo_boards(*about, pattern, *control), self.lenses)
            else:
                found = detect_frames(*about, target, *control).recording()
        for line in filter(None, (found.told, *found.unused)):
            self.tell(line)
        recording = _as_stated(found.recording, self.known)
        if isinstance(target, Board):
            return recording
        return replace(recording, object=self.known.object)

    def _frames(self, target: Target) -> list[Frame]:
        with self._photographs() as photographs:
            pairing = pairing_of(photographs, self.path, Choice(self.way, heard=self.heard))
            self.tell(f"{len(photographs)} photographs. {pairing.sentence}")
            about = pairing.moments, photographs, self.lenses, target
            found = detect_frames(*about, self.workers, self.begin, self.progress)
        frames, (first, second) = found.frames[CAMERAS], self.lenses.values()
        if found.motion:
            self.tell(pairing.told_by(found.motion).sentence)
        self.tell(describe_frames(frames))
        if not found.motion and (slip := find_slip(frames, (first, second))) is not None:
            self.tell(f"{slip} Take it out of the folder, and find the targets again.")
        return frames

    def _boards(self, board: Board) -> Recording:
        """The boards of both cameras.

        The lenses are those of the data set; without one, they come from the same photographs.
        """
        with self._photographs() as photographs:
            pairing = pairing_of(photographs, self.path, Choice(self.way, heard=self.heard))
            pattern = self._pattern(board, photographs, pairing.moments)
            known = self.known if self.is_described else None
            return self.recording(photographs, pattern, pairing, known)

    def recording(
        self,
        photographs: Photographs,
        pattern: BoardPattern,
        pairing: Pairing,
        known: Recording | None = None,
        settings: LensSettings | None = None,
    ) -> Recording:
        """The recording of boards of known size; says which points a fisheye sees too far out.

        Args:
            known: cameras and lengths; without, the lenses come from the same boards.
            settings: of these lenses; None: the model that predicts better.
        """
        cameras = self.lenses if known else {}
        about = pairing.moments, photographs, cameras or dict.fromkeys(CAMERAS), pattern
        control = self.workers, self.begin, self.progress
        boards = find_stereo_boards(*about, *control, alone=pairing.alone)
        self.tell(f"{pairing.told_by(boards.motion).sentence} {boards.sentence}")
        if not cameras:
            self.begin("draws calibrated")
            lenses = lenses_of_boards(boards, settings, self.workers, self.progress)
            for which, lens in lenses.items():
                cameras[which] = lens.camera
                note = note_on_model(lens.search, lens.settings)
                self.tell(f"The {which}'s lens: {lens_answer(lens)} {note}".rstrip())
        found = recording_of(boards, cameras, self.path.stem).recording
        if beyond := beyond_in_words(found.beyond_view):
            self.tell(beyond)
        return _as_stated(found, known) if known else found

    @contextmanager
    def _photographs(self) -> Iterator[dict[str, Path]]:
        with tempfile.TemporaryDirectory(prefix="stereocal-") as store:
            self.begin("photographs unpacked")
            found = photographs_in(self.path, Path(store), self.progress)
            yield dict(of_the_bar(found))

    def _pattern(
        self, stated: Board, photographs: Photographs, moments: Moments | ByHand
    ) -> BoardPattern:
        """With the size of the board that moves before the cameras, or else that most show, where
        none is stated."""
        if stated.size:
            return stated.pattern()
        names = names_by_camera(moments, self.cameras).values()
        held = held_object([{name: photographs[name] for name in own} for own in names])
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
        return stated.pattern(str(board))


def pairing_of(photographs: Mapping[str, Path], source: Path, choice: Choice) -> Pairing:
    """The pairs of photographs.

    Raises:
        StereocalError: there are no pairs in the way chosen; or, if none is, no way is sure.
    """
    proposal, way = propose(when_taken(photographs), choice), choice.way
    pairing = proposal.pairing
    if way is not None and proposal.way != way:
        raise StereocalError(f"{source}: no two photographs can be paired by --pair-by {way}.")
    if not pairing.pairs:
        raise StereocalError(f"{source}: {pairing.sentence}")
    if pairing.ambiguous and way is None:
        ways = " or ".join(f"--pair-by {each}" for each in proposal.ways)
        raise StereocalError(f"{source}: {pairing.sentence} Or state how to pair them: {ways}.")
    return pairing


def _as_stated(found: Recording, known: Recording) -> Recording:
    """The recording with the cameras and lengths of the data set."""
    names = ("name", "cameras", "baselines_m", "baseline_sigma_m", "notes")
    return replace(found, **{name: getattr(known, name) for name in names})
