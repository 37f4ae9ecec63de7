"""Boards before two cameras with one thing wrong, and sound ones: what is named, what is silent.

    python -m benchmarks.wrong_boards [wrong|sound|wide|wide-sound|late|real] [--trials 4]
        [--first 0] [--frames 20] [--mistake NAME ...] [--said]

Pairs of unlike cameras and boards of several sizes (`tests.rigs.board_pairs`), bent by 0.4 % of
their width or not, noise of 0.1 to 0.5 px; `wide`: before fisheyes. `real` puts each kind
into OpenCV's sample of 13 pairs of photographs, but the two that need the truth. Wrong is a file
whose 95 % length error on 40 further boards is more than 3 times what it states, or whose baseline
is more than 5 % off.
"""

import argparse
import os
import time
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.boards import boards_in, cameras_of, uncertainties
from benchmarks.said import MOST, Said, error_of_files, in_words, judged
from benchmarks.said import said_of as said_of_dataset
from benchmarks.studies import parser_of
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.intrinsics.stereo_boards import found_of
from stereocal.rig.camera import Camera
from stereocal.rig.pair import Pair
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.rigs.board_mistakes import MISTAKES
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


def said_of(pair: BoardPair, make: Callable[[], Pair] | None = None) -> Said:
    """All that `calibrate` says of a pair, as it is or as it is made."""
    error = None if pair.truth is None else partial(_error, pair)
    return said_of_dataset(make or (lambda: pair.dataset), error)


def _error(pair: BoardPair, answer: PairAnswer) -> float:
    """`error_of_files` on the diagonals of further boards."""
    assert pair.truth is not None
    rng, corners = np.random.default_rng(5), true_corners(pair.board, 0.0)
    far = float(np.median([pose.T[2] for pose in pair.placings]))
    placings = draw_placings(pair.truth, far, pair.board, rng, FURTHER)
    seen = [images_of(pair.truth, pose, corners) for pose in placings]
    ends = np.stack([each[[0, -1]] for each in seen if each is not None])
    length = float(np.linalg.norm(corners[-1] - corners[0]))
    return error_of_files(answer, pair.truth, ends, length)


def spoiled(name: str, pairs: Iterable[tuple[int, BoardPair]], say: bool) -> None:
    """Print what became of pairs with a mistake."""
    mistake, found, lines, begun = MISTAKES[name], Counter[str](), list[str](), time.process_time()
    for number, pair in pairs:
        what = said_of(pair, partial(mistake.data, pair, np.random.default_rng([number, 5])))
        word = judged(what, mistake.words)
        found[word] += 1
        lines.append(f"      {number}: {word}: {what.error or 0:.1f} times; {what.words[:300]}")
    spent = time.process_time() - begun
    print(f"  {name}: {in_words(found)} ({spent:.0f} s of CPU time)", flush=True)
    if say:
        print("\n".join(lines), flush=True)


def wrong(asked: argparse.Namespace, draw: Draw = lens) -> None:
    """Each kind of mistake."""
    numbers = range(asked.first, asked.first + asked.trials)
    for name in asked.mistake or MISTAKES:
        pairs = ((n, sound(n, asked.frames, "square" in name, draw)) for n in numbers)
        spoiled(name, pairs, asked.said)


def sound_pairs(asked: argparse.Namespace, draw: Draw = lens) -> None:
    """Nothing wrong: a third of them with a measured baseline."""
    accused, far_off = {}, []
    for number in range(1000 + asked.first, 1000 + asked.first + asked.trials):
        said = said_of(sound(number, asked.frames, number % 3 == 1, draw))
        if said.accusations:
            accused[number] = said.accusations
        if said.error is None or said.error > MOST:
            far_off.append(number)
    print(f"  accused {len(accused)} of {asked.trials}; files far off {far_off}")
    for number, notes in accused.items():
        print(f"    {number}: {notes}")


def late(asked: argparse.Namespace) -> None:
    """Waved boards, the secondary late by a part of a frame, or not."""
    trials = asked.trials
    for frames in (0.0, 0.3, 0.7):
        found = [
            PairRun(with_baseline_found(waved(n, frames).dataset)).screening.shift
            for n in range(asked.first, asked.first + trials)
        ]
        right = [it for it in found if it and abs(it.frames - frames) < 4.0 * it.sigma]
        print(
            f"  {frames} frames late: {sum(map(bool, found))} of {trials} brought into step, "
            f"{len(right)} within 4 standard errors",
            flush=True,
        )


def real(asked: argparse.Namespace) -> None:
    """OpenCV's sample, with each kind put into it."""
    boards = boards_in(Path(os.environ["STEREOCAL_REAL_DATA"]) / "opencv_boards")
    cameras = cameras_of(boards, uncertainties(boards, SUBSET))
    one, two = cameras.values()
    recording = found_of(boards, cameras).recording
    images = recording.images()[1]
    assert recording.object.board is not None
    pair = BoardPair((one, two), recording.object.board, images)
    print(f"  sound: {said_of(pair).accusations or 'nothing accused'}")
    for name in asked.mistake or MISTAKES:
        if not MISTAKES[name].needs_truth:
            own = BoardPair((one, two), pair.board, images, 0.0997) if "square" in name else pair
            spoiled(name, [(0, own)], asked.said)


STUDIES: dict[str, tuple[Callable[[argparse.Namespace], None], int]] = {
    "wrong": (wrong, 4),
    "sound": (sound_pairs, 60),
    "wide": (partial(wrong, draw=wide_lens), 2),
    "wide-sound": (partial(sound_pairs, draw=wide_lens), 60),
    "late": (late, 3),
    "real": (real, 1),
}


def main() -> None:
    """The studies that the command line names."""
    parser = parser_of(__doc__)
    parser.add_argument("studies", nargs="*", choices=[*STUDIES, []], default=[], metavar="STUDY")
    parser.add_argument("--trials", type=int)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--frames", type=int, default=20)
    parser.add_argument("--mistake", action="append", choices=[*MISTAKES])
    parser.add_argument("--said", action="store_true", help="print what is said")
    asked = parser.parse_args()
    for name in asked.studies or STUDIES:
        study, usual = STUDIES[name]
        own = argparse.Namespace(**{**vars(asked), "trials": asked.trials or usual})
        print(f"{name}, {own.trials} trials:", flush=True)
        study(own)


if __name__ == "__main__":
    main()
