"""Boards before two cameras with one thing wrong, and sound ones: what is named, what is silent.

    python -m benchmarks.wrong_boards [wrong|sound|late|real] [--trials 4]

Pairs of unlike cameras and boards of several sizes (`tests.rigs.board_pairs`), 20 frames, bent by
0.4 % of their width or not, noise of 0.1 to 0.5 px. `real` puts each kind into OpenCV's sample of
13 pairs of photographs, but the two that need the truth. Wrong is a file whose 95 % length error on
40 further boards is more than 3 times what it states, or whose baseline is more than 5 % off.
"""

import os
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.boards import boards_in, camera_of, uncertainties
from benchmarks.studies import run_studies
from stereocal.errors import StereocalError
from stereocal.intrinsics.stereo_boards import recording_of
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.rig.camera import CAMERAS
from stereocal.rig.rig import Rig
from stereocal.workflow import Run
from tests.rigs.board_mistakes import MISTAKES, BoardMistake
from tests.rigs.board_pairs import BoardPair, draw_placings, images_of, sound, true_corners, waved

SUBSET, FURTHER, MOST, MOST_BASELINE = 20, 40, 3.0, 0.05
REFUSED, WARNED, NOTED, OTHER, WRONG, RIGHT = (
    *("refused and named", "named, and not to be relied on", "named in a note"),
    "refused for another reason",
    *("silent and wrong", "silent, and right"),
)
ALWAYS = ("The baseline was not measured", "The corners of the board run counter-clockwise")
"""Notes that accuse nothing."""


@dataclass(frozen=True)
class Said:
    """What was said of a pair, and its files' error over the stated one; None without files."""

    words: str
    is_refused: bool
    accusations: tuple[str, ...]
    error: float | None = None
    is_cautioned: bool = False


def said_of(pair: BoardPair) -> Said:
    """All that `calibrate` says of a pair."""
    try:
        run = Run(with_baseline_found(pair.recording.pair("primary", "secondary")))
        accused = (item.advice for item in run.inputs if item.accused)
        notes = (*run.calibration.warnings, run.recommendation.caution, *accused)
        error = None if pair.truth is None else _error(pair, run)
    except StereocalError as found:
        return Said(str(found).lower(), True, (str(found),))
    accusing = tuple(note for note in notes if note and not note.startswith(ALWAYS))
    return Said(" ".join(notes).lower(), False, accusing, error, bool(run.recommendation.caution))


def _error(pair: BoardPair, run: Run) -> float:
    """The true 95 % length error of the file to measure with, over the upper end of the stated; at
    least the error of its baseline over `MOST_BASELINE`, times `MOST`."""
    assert pair.truth is not None
    file = run.sets[run.recommendation.measure.method]
    rng, rig = np.random.default_rng(5), Rig(file.primary, file.secondary, file.pose)
    corners, errors = true_corners(pair.board, 0.0), []
    far = float(np.median([pose.T[2] for pose in pair.placings]))
    for pose in draw_placings(pair.truth, far, pair.board, rng, FURTHER):
        seen = images_of(pair.truth, pose, corners)
        assert seen is not None
        points = rig.reconstruct(seen[:, 0], seen[:, 1])
        length = np.linalg.norm(points[-1] - points[0])
        errors.append(abs(length / np.linalg.norm(corners[-1] - corners[0]) - 1.0))
    off = float(abs(rig.pose.baseline / pair.truth.pose.baseline - 1.0) / MOST_BASELINE * MOST)
    stated = run.recommendation.measure.length_p95.forecast
    if stated is None or not np.isfinite(stated.high):
        return off
    return float(max(np.percentile(errors, 95) / stated.high, off))


def judged(mistake: BoardMistake, pair: BoardPair, rng: np.random.Generator) -> str:
    """What became of a pair with a mistake."""
    said = said_of(mistake.spoil(pair, rng))
    named = any(word in said.words for word in mistake.words)
    if said.is_refused:
        return REFUSED if named else OTHER
    if named:
        return WARNED if said.is_cautioned else NOTED
    return RIGHT if said.error is not None and said.error < MOST else WRONG


def wrong(trials: int) -> None:
    """Each kind of mistake."""
    for name, mistake in MISTAKES.items():
        begun = time.monotonic()
        found = Counter(
            judged(mistake, sound(n, baseline="square" in name), np.random.default_rng([n, 5]))
            for n in range(trials)
        )
        _print(name, found, begun)


def sound_pairs(trials: int) -> None:
    """Nothing wrong: a third of them with a measured baseline."""
    accused, far_off = {}, []
    for number in range(trials):
        said = said_of(sound(1000 + number, baseline=number % 3 == 0))
        if said.accusations:
            accused[1000 + number] = said.accusations
        if said.error is None or said.error > MOST:
            far_off.append(1000 + number)
    print(f"  accused {len(accused)} of {trials}; files far off {far_off}")
    for number, notes in accused.items():
        print(f"    {number}: {notes}")


def late(trials: int) -> None:
    """Waved boards, the secondary late by a part of a frame, or not."""
    for frames in (0.0, 0.3, 0.7):
        found = [
            Run(with_baseline_found(waved(n, frames).recording.pair(*CAMERAS))).screening.shift
            for n in range(trials)
        ]
        right = [it for it in found if it and abs(it.frames - frames) < 4.0 * it.sigma]
        print(
            f"  {frames} frames late: {sum(map(bool, found))} of {trials} brought into step, "
            f"{len(right)} within 4 standard errors",
            flush=True,
        )


def real(_: int) -> None:
    """OpenCV's sample, with each kind put into it."""
    boards = boards_in(Path(os.environ["STEREOCAL_REAL_DATA"]) / "opencv_boards")
    one, two = map(camera_of, boards.searches, uncertainties(boards, SUBSET))
    recording = recording_of(boards, (one, two), "boards")
    images = recording.images()[1]
    assert recording.object.board is not None
    pair = BoardPair((one, two), recording.object.board, images)
    print(f"  sound: {said_of(pair).accusations or 'nothing accused'}")
    for name, mistake in MISTAKES.items():
        if mistake.needs_truth:
            continue
        begun = time.monotonic()
        measured = BoardPair((one, two), pair.board, images, 0.0997) if "square" in name else pair
        _print(name, Counter([judged(mistake, measured, np.random.default_rng(5))]), begun)


def _print(name: str, found: Counter[str], begun: float) -> None:
    each = ", ".join(f"{what} {number}" for what, number in found.items())
    print(f"  {name}: {each} ({time.monotonic() - begun:.0f} s)", flush=True)


STUDIES = {"wrong": (wrong, 4), "sound": (sound_pairs, 60), "late": (late, 3), "real": (real, 1)}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__)
