"""Real recordings with one thing wrong, whole or cut in time: what is named, what is silent.

    python -m benchmarks.real_mistakes RECORDING ... [--parts 2] [--mistake NAME ...] [--said]

A recording is a data set, a pair of one with more cameras (sample_data/rig:1-3), or of all of
them. The figure is how far its files are from those of the same frames as they were recorded: the
turn in their standard errors, or 3 for each 2 % of a baseline, whichever is more; `SILENT` is more
than 3 with nothing said; images mirrored alike keep lengths right. Boards: `wrong_boards real`.
"""

import argparse
import re
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from itertools import combinations

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.quarters import recording
from benchmarks.said import MOST, RIGHT, WRONG, in_words, judged, said_of
from benchmarks.studies import parser_of
from benchmarks.wrong_rigs import largest_z, told, with_error
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.small_steps import pose_places
from stereocal.fit.rig_file import RigFile
from stereocal.formats.dataset_files import read_recording
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.rigs.mistakes import Change
from tests.rigs.pair_mistakes import MISTAKES as OF_PAIRS
from tests.rigs.pair_mistakes import Mistake
from tests.rigs.spoiled_rigs import MISTAKES as MADE

MOST_BASELINE = 0.02
OF_RIGS: Mapping[str, Change] = {
    name: made.args[0] for name, made in MADE.items() if isinstance(made, partial)
}
"""Those that need no truth."""


def far_from(truth: Pose, sigma_rad: float, answer: PairAnswer) -> float:
    """How far the file to measure with is from that of the sound recording."""
    pose = answer.sets[answer.recommendation.measure.method].pose
    turn = Rotation.from_matrix(pose.R @ truth.R.T).magnitude() / sigma_rad
    return float(max(turn, abs(pose.baseline / truth.baseline - 1.0) / MOST_BASELINE * MOST))


def of_pair(data: Pair, asked: argparse.Namespace) -> None:
    """Each kind of mistake in each part of a recording of two cameras."""
    for part in np.array_split(data.correspondences.frames, asked.parts):
        own = data.of_frames(part)
        sound = PairAnswer(PairRun(own))
        said = said_of(partial(run_data, own), None)
        print(f"  frames {part[0]} to {part[-1]}, sound: {said.accusations or 'nothing accused'}")
        pose = sound.sets[sound.recommendation.measure.method].pose
        sigma = float(np.sqrt(np.diag(sound.run.refined_set.covariance)[pose_places(1)][:3].sum()))
        error = partial(far_from, pose, sigma)
        for name, mistake in OF_PAIRS.items():
            if mistake.change is not None and name in (asked.mistake or OF_PAIRS):
                _of_pair(name, mistake, own, error, asked.said)


def run_data(data: Pair) -> Pair:
    """As it was recorded."""
    return data


def _of_pair(
    name: str, mistake: Mistake, data: Pair, error: Callable[[PairAnswer], float], say: bool
) -> None:
    assert mistake.change is not None
    begun, change = time.process_time(), mistake.change
    said = said_of(lambda: change(data, np.random.default_rng(5)), error)
    spent, word = time.process_time() - begun, judged(said, mistake.names)
    word = RIGHT if word == WRONG and mistake.harmless else word
    print(f"  {name}: {word}, {said.error or 0:.1f} ({spent:.0f} s)")
    if say:
        print(f"      {said.words[:400]}", flush=True)


def of_rig(data: Recording, asked: argparse.Namespace) -> None:
    """Each kind of mistake in each part of a recording of three cameras and more."""
    for part in np.array_split(np.unique(data.frame), asked.parts):
        own, found = data.where(np.isin(data.frame, part)), Counter[str]()
        usual, text, sound = told(own)
        print(f"  frames {part[0]} to {part[-1]}, sound: {usual}; {text}", flush=True)
        assert sound is not None
        usual_notes = {*map(_kind, text.split("Note: "))}
        for name in asked.mistake or OF_RIGS:
            begun = time.process_time()
            word, text, rig = told(OF_RIGS[name](own, np.random.default_rng(5)))
            off = 0.0
            if rig is not None:
                notes = [it for it in text.split("Note: ") if _kind(it) not in usual_notes]
                off, text = far_from_rig(sound, rig), " ".join(notes)
                word = with_error("noted" if notes else "silent", off)
            found[word] += 1
            spent = time.process_time() - begun
            print(f"    {name}: {word}, {off:.1f} ({spent:.0f} s)", flush=True)
            if asked.said:
                print(f"      {text}", flush=True)
        print(f"  {in_words(found)}")


def _kind(note: str) -> str:
    """What a note says first, without its numbers."""
    return re.sub(r"[\d.]+", "#", note.partition(":")[0])


def far_from_rig(sound: RigFile, rig: RigFile) -> float:
    """How far a rig is from that of the sound recording; infinite if it lacks a camera."""
    if [*rig.poses] != [*sound.poses]:
        return np.inf
    lengths = [
        abs(rig.pair(*pair).pose.baseline / sound.pair(*pair).pose.baseline - 1.0)
        for pair in combinations(sound.names, 2)
    ]
    return float(max(largest_z(rig, sound.poses), max(lengths) / MOST_BASELINE * MOST))


def main() -> None:
    """The recordings that the command line names."""
    parser = parser_of(__doc__)
    parser.add_argument("recordings", nargs="+")
    parser.add_argument("--parts", type=int, default=1)
    parser.add_argument("--mistake", action="append")
    parser.add_argument("--said", action="store_true", help="print what is said")
    asked = parser.parse_args()
    for name in asked.recordings:
        print(name, flush=True)
        try:
            pair = recording(name)
        except StereocalError:  # it has more cameras
            of_rig(read_recording(name), asked)
        else:
            of_pair(pair, asked)


if __name__ == "__main__":
    main()
