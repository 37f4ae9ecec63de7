"""The search of photographs: a bar or a board before two cameras and more, and lenses of boards."""

from collections.abc import Callable, Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from stereocal.detection.target import Sighting, Target
from stereocal.frames.all_cameras import Found
from stereocal.frames.pairing import Pairing
from stereocal.frames.search import STAGES, detect_frames
from stereocal.intrinsics.boards import FoundBoard
from stereocal.intrinsics.calibrate_lens import LensCalibration
from stereocal.intrinsics.lens_fit import LensSettings
from stereocal.intrinsics.quality import lens_answer, note_on_model
from stereocal.intrinsics.stereo_boards import (
    find_stereo_boards,
    found_of,
    lenses_of_boards,
    stages_of,
)
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.photograph_files import Photographs
from stereocal.system.tasks import Earlier, Progress

LENSES_STAGE = "draws calibrated"


@dataclass(frozen=True)
class PhotographSearch:
    """A search of the photographs of two cameras and more for what is held."""

    pairing: Pairing
    photographs: Photographs
    cameras: Mapping[str, Camera | None]
    """Their lenses; None: of boards they are made from the same photographs."""
    held: Target | BoardPattern
    settings: LensSettings | None = None
    """Of lenses that are made; None: with the model that predicts better."""

    @property
    def lenses(self) -> dict[str, Camera]:
        """Those that are known."""
        return {name: camera for name, camera in self.cameras.items() if camera is not None}

    @property
    def stages(self) -> tuple[str, ...]:
        """What is counted, in words."""
        if not isinstance(self.held, BoardPattern):
            return STAGES
        lenses = () if len(self.lenses) == len(self.cameras) else (LENSES_STAGE,)
        return (*stages_of(self.cameras), *lenses)

    def run(
        self,
        executor: Executor,
        begin: Callable[[str], None],
        progress: Progress,
        before: Callable[[Any], Earlier[Any] | None] = lambda _: None,
        tell: Callable[[str], object] | None = None,
    ) -> Found:
        """Search.

        Args:
            begin: called with each of `stages` when it begins.
            progress: called with how much of it is done; what it raises ends the search.
            before: what a search that was not finished has found, by the type of what is found.
            tell: called with what was found, a sentence each time.

        Raises:
            StereocalError: no board, or of more than two cameras nothing at all, is seen by two; or
                photographs of boards do not fit their lenses.
        """
        say = tell or (lambda _: None)
        if not isinstance(self.held, BoardPattern):
            result = detect_frames(
                self.pairing,
                self.photographs,
                self.lenses,
                self.held,
                executor,
                begin,
                progress,
                before(Sighting),
            )
            words = [result.pairing.sentence if result.pairing.motion else "", result.sentence]
        else:
            boards = find_stereo_boards(
                self.pairing,
                self.photographs,
                self.cameras,
                self.held,
                executor,
                begin,
                progress,
                before(FoundBoard),
            )
            if len(self.cameras) == 2:
                say(f"{boards.pairing.sentence} {boards.sentence}")
            made = dict[str, LensCalibration]()
            if LENSES_STAGE in self.stages:
                begin(LENSES_STAGE)
                made = lenses_of_boards(boards, self.settings, executor, progress)
            for which, lens in made.items() if tell else ():  # the note takes fits of its own
                note = note_on_model(lens.search, lens.settings)
                say(f"The {which}'s lens: {lens_answer(lens)} {note}".rstrip())
            result = found_of(boards, self.lenses, made)
            words = [result.beyond]
        if len(self.cameras) > 2:
            words = [result.pairing.sentence, *result.unused]
        for sentence in filter(None, words):
            say(sentence)
        return result


def share_in_one_pose(recording: Recording, near_px: float) -> float:
    """The share of the points of two cameras that lie within so many px of the epipolar lines of
    one pose. It is small where the photographs of different moments were paired."""
    both = recording.pair(*CAMERAS)
    rows, cameras = both.correspondences, (both.primary, both.secondary)
    first, second = cameras[0].undistort(rows.primary), cameras[1].undistort(rows.secondary)
    focal = float(np.mean([camera.K[[0, 1], [0, 1]] for camera in cameras]))
    cv2.setRNGSeed(0)
    _, near = cv2.findEssentialMat(first, second, np.eye(3), cv2.RANSAC, 0.9999, near_px / focal)
    return 0.0 if near is None else float(np.mean(np.asarray(near) > 0))
