"""Boards before two cameras with one thing wrong, and sound ones: what is named, what is silent.

    python -m benchmarks.wrong_boards [wrong|sound|wide|wide-sound|late|real] [--trials 4]

Pairs of unlike cameras and boards of several sizes (`tests.rigs.board_pairs`), 20 frames, bent by
0.4 % of their width or not, noise of 0.1 to 0.5 px; `wide`: before fisheyes. `real` puts each kind
into OpenCV's sample of 13 pairs of photographs, but the two that need the truth. Wrong is a file
whose 95 % length error on 40 further boards is more than 3 times what it states, or whose baseline
is more than 5 % off.
"""

import os
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.boards import boards_in, camera_of, uncertainties
from benchmarks.said import MOST, Said, error_of_files, in_words, judged
from benchmarks.said import said_of as said_of_dataset
from benchmarks.studies import run_studies
from stereocal.intrinsics.stereo_boards import recording_of
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.workflow import Run
from tests.rigs.board_mistakes import MISTAKES, BoardMistake
from tests.rigs.board_pairs import (
    BoardPair,
    draw_placings,
    images_of,
    lens,
    sound,
    true_corners,
    waved,
    wide_lens,
)

SUBSET, FURTHER = 20, 40
Draw = Callable[[np.random.Generator], Camera]


def said_of(pair: BoardPair) -> Said:
    """All that `calibrate` says of a pair."""
    error = None if pair.truth is None else partial(_error, pair)
    return said_of_dataset(lambda: pair.recording.pair("primary", "secondary"), error)


def _error(pair: BoardPair, run: Run) -> float:
    """`error_of_files` on the diagonals of further boards."""
    assert pair.truth is not None
    rng, corners = np.random.default_rng(5), true_corners(pair.board, 0.0)
    far = float(np.median([pose.T[2] for pose in pair.placings]))
    placings = draw_placings(pair.truth, far, pair.board, rng, FURTHER)
    seen = [images_of(pair.truth, pose, corners) for pose in placings]
    ends = np.stack([each[[0, -1]] for each in seen if each is not None])
    length = float(np.linalg.norm(corners[-1] - corners[0]))
    return error_of_files(run, pair.truth, ends, length)


def spoiled(mistake: BoardMistake, pair: BoardPair, rng: np.random.Generator) -> str:
    """What became of a pair with a mistake."""
    return judged(said_of(mistake.spoil(pair, rng)), mistake.words)


def wrong(trials: int, draw: Draw = lens) -> None:
    """Each kind of mistake."""
    for name, mistake in MISTAKES.items():
        begun = time.monotonic()
        found = Counter(
            spoiled(mistake, sound(n, 20, "square" in name, draw), np.random.default_rng([n, 5]))
            for n in range(trials)
        )
        _print(name, found, begun)


def sound_pairs(trials: int, draw: Draw = lens) -> None:
    """Nothing wrong: a third of them with a measured baseline."""
    accused, far_off = {}, []
    for number in range(trials):
        said = said_of(sound(1000 + number, 20, number % 3 == 0, draw))
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
        _print(name, Counter([spoiled(mistake, measured, np.random.default_rng(5))]), begun)


def _print(name: str, found: Counter[str], begun: float) -> None:
    print(f"  {name}: {in_words(found)} ({time.monotonic() - begun:.0f} s)", flush=True)


STUDIES: dict[str, tuple[Callable[[int], None], int]] = {
    "wrong": (wrong, 4),
    "sound": (sound_pairs, 60),
    "wide": (partial(wrong, draw=wide_lens), 2),
    "wide-sound": (partial(sound_pairs, draw=wide_lens), 60),
    "late": (late, 3),
    "real": (real, 1),
}


if __name__ == "__main__":
    run_studies(STUDIES, __doc__)
