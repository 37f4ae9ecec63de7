"""Real recordings with one thing wrong, whole or cut in time: what is named, what is silent.

    python -m benchmarks.real_mistakes RECORDING ... [--parts 2] [--mistake NAME ...] [--said]

A recording is a data set, a pair of one with more cameras (sample_data/rig:1-3), or of all of
them. `file` is how far its files are from those of the same frames as they were recorded: the
turn in their standard errors, or the error of the baseline in 2 %, whichever is more; `SILENT` is
more than 3 with nothing said; images mirrored alike keep lengths right. Boards: `wrong_boards
real`.
"""

import argparse
import re
import time
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.quarters import recording
from benchmarks.said import MOST, RIGHT, WRONG, in_words, judged, said_of
from benchmarks.studies import parser_of
from benchmarks.wrong_rigs import told
from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import read_recording
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Pose
from stereocal.rig.recording import Recording
from stereocal.workflow import Run
from tests.rigs.pair_mistakes import MISTAKES as OF_PAIRS
from tests.rigs.pair_mistakes import Mistake
from tests.rigs.spoiled_rigs import MISTAKES as MADE
from tests.rigs.spoiled_rigs import Change

MOST_BASELINE = 0.02
OF_RIGS: Mapping[str, Change] = {
    name: made.args[0] for name, made in MADE.items() if isinstance(made, partial)
}
"""Those that need no truth."""


def far_from(truth: Pose, sigma_rad: float, run: Run) -> float:
    """How far the file to measure with is from that of the sound recording."""
    pose = run.sets[run.recommendation.measure.method].pose
    turn = Rotation.from_matrix(pose.R @ truth.R.T).magnitude() / sigma_rad
    return float(max(turn, abs(pose.baseline / truth.baseline - 1.0) / MOST_BASELINE * MOST))


def of_pair(data: Dataset, asked: argparse.Namespace) -> None:
    """Each kind of mistake in each part of a recording of two cameras."""
    for part in np.array_split(data.correspondences.frames, asked.parts):
        own = data.of_frames(part)
        sound = Run(own)
        said = said_of(partial(run_data, own), None)
        print(f"  frames {part[0]} to {part[-1]}, sound: {said.accusations or 'nothing accused'}")
        pose = sound.sets[sound.recommendation.measure.method].pose
        sigma = float(np.sqrt(np.trace(sound.refined_set.covariance[:3, :3])))
        error = partial(far_from, pose, sigma)
        for name, mistake in OF_PAIRS.items():
            if mistake.change is not None and name in (asked.mistake or OF_PAIRS):
                _of_pair(name, mistake, own, error, asked.said)


def run_data(data: Dataset) -> Dataset:
    """As it was recorded."""
    return data


def _of_pair(
    name: str, mistake: Mistake, data: Dataset, error: Callable[[Run], float], say: bool
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
        usual = dict[str, str]()
        for name in ("sound", *(asked.mistake or OF_RIGS)):
            change: Change = OF_RIGS.get(name, lambda recording, _: recording)
            begun = time.process_time()
            word, text = told(change(own, np.random.default_rng(5)), None)
            notes = {re.sub(r"[\d.]+", "#", note): note for note in text.split("Note: ")}
            usual = notes if name == "sound" else usual
            further = [note for kind, note in notes.items() if kind not in usual]
            if word == "noted" and name != "sound":
                word, text = word if further else "as when sound", " ".join(further)
            found[word] += 1
            print(f"  {name}: {word} ({time.process_time() - begun:.0f} s)", flush=True)
            if asked.said or word.isupper():
                print(f"      {text}", flush=True)
        print(f"  frames {part[0]} to {part[-1]}: {in_words(found)}")


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
