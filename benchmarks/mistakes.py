"""Recordings with one thing wrong, and sound ones: what is named, what is silent, what is off.

    python -m benchmarks.mistakes [wrong|sound|real|frames|points] [--trials N] [--first 0]
        [--kind pairs ...] [--mistake NAME ...] [--frames 20] [--said]
        [--data RECORDING ...] [--parts 1]

Kinds: pairs (six kinds of bars), balls, tags, fisheyes (`tests.rigs.culprits`: balls and tags reach
a calibration as points with the noise and number of photographs of them); boards and wide-boards
(before fisheyes; `tests.rigs.board_pairs`, bent by 0.4 % of their width or not); rigs of 3 to 9
cameras (`tests.rigs.several_cameras`; `--kind rigs` is all of them), by what `stereocal rig` does.

- wrong: each mistake: refused or named, or silent; a file is wrong if its 95 % length error on
  further bars or boards is more than 3 times what it states, its baseline more than 5 % off, or a
  rotation of a rig more than 3 stated errors;
- sound: nothing wrong: how many are accused, how many files are off;
- real: each mistake put into real recordings, whole or cut in time (`--parts`), without `--data`
  into OpenCV's 13 pairs of boards. The figure is how far the files are from those of the same
  frames as they were recorded: the turn in their standard errors, or 3 for each 2 % of a baseline;
- frames: A and B exchanged in 0 to 3 of 25 frames; points: 30 % of them off by 20 to 100 px.
"""

import contextlib
import io
import re
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from itertools import chain, combinations
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.boards import boards_in, cameras_of, uncertainties
from benchmarks.studies import Asked, Study, pair_of, real_data, recording_of, rms, run_studies
from stereocal.calibration.methods import Method
from stereocal.cli import main as stereocal
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.small_steps import pose_places
from stereocal.fit.rig_file import RIG, ROTATION, RigFile
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.formats.dataset_files import pack_recording
from stereocal.intrinsics.stereo_boards import found_of
from stereocal.library.calibrations import CalibrationRun, calibrate
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Scene
from stereocal.system.array_types import FloatArray
from stereocal.verdict.in_words import why_not_trusted
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.files import write
from tests.rigs import board_pairs, culprits, several_cameras
from tests.rigs.accuracy import turned
from tests.rigs.board_pairs import BoardPair
from tests.rigs.mistakes import (
    BARS,
    BOARDS,
    RIGS,
    mistakes_of,
    rig,
    with_frames_exchanged,
    with_points_off,
)

OF_PAIRS, OF_BOARDS, OF_RIGS = map(mistakes_of, (BARS, BOARDS, RIGS))

MOST, MOST_BASELINE, FAR_BASELINE = 3.0, 0.05, 0.02
"""Stated errors and shares of a baseline beyond which a file is wrong; the last of real ones."""
REFUSED, WARNED, NOTED, OTHER, WRONG, RIGHT, TRACEBACK = (
    *("refused and named", "named, and not to be relied on", "named in a note"),
    "refused for another reason",
    *("SILENT AND WRONG", "silent, and right"),
    "TRACEBACK",
)
ALWAYS = (
    "The baseline was not measured",
    "The corners of the board run counter-clockwise",
    "5 % of the bars have length errors above",
)
"""Notes that accuse nothing, the last of noise before wide lenses."""
FURTHER_BARS, FURTHER_BOARDS, SUBSET = 300, 40, 20
PAIRS = tuple(culprits.KINDS)[:6]


@dataclass(frozen=True)
class Said:
    """What was said of a recording, and its files' error over the stated one; None without."""

    words: str
    accusations: tuple[str, ...]
    is_refused: bool = False
    is_cautioned: bool = False
    error: float | None = None

    def judged(self, words: tuple[str, ...], harmless: bool = False) -> str:
        """What became of a recording with a mistake that any of the words names."""
        named = any(word.lower() in self.words for word in words)
        if self.is_refused:
            return REFUSED if named else OTHER
        if named:
            return WARNED if self.is_cautioned else NOTED
        right = harmless or (self.error is not None and self.error < MOST)
        return RIGHT if right else WRONG


def said_of(make: Callable[[], Pair], error: Callable[[PairAnswer], float] | None) -> Said:
    """All that `calibrate` says of a recording.

    Args:
        make: may raise what a reader of the files would.
        error: of the files, over what they state; None where the truth is not known.
    """
    try:
        run = PairRun(with_baseline_found(make()))
        answer = PairAnswer(run)
        accused = [item for item in run.inputs if item.accused]
        notes = (
            *filter(None, [run.screening.time_note]),
            *run.calibration.warnings,
            answer.recommendation.caution,
            *(f"{item.key} {' '.join(item.rivals)} {item.advice}" for item in accused),
        )
        of_files = error and error(answer)
    except StereocalError as found:
        return Said(str(found).lower(), (str(found),), is_refused=True)
    accusing = tuple(note for note in notes if note and not note.startswith(ALWAYS))
    caution = bool(answer.recommendation.caution)
    return Said(" ".join(notes).lower(), accusing, is_cautioned=caution, error=of_files)


def error_of_files(truth: Rig, ends: FloatArray, length_m: float, answer: PairAnswer) -> float:
    """The true 95 % length error of the file to measure with, over the upper end of the stated; at
    least the error of its baseline over `MOST_BASELINE`, times `MOST`.

    Args:
        ends: (n, 2, 2, 2): by bar and end, the pixels in both cameras.
        length_m: of the bars.
    """
    file = answer.sets[answer.recommendation.measure.method]
    own = Rig(file.primary, file.secondary, file.pose)
    with np.errstate(invalid="ignore"):
        one, other = (own.reconstruct(ends[:, k, 0], ends[:, k, 1]) for k in (0, 1))
    errors = np.abs(np.linalg.norm(one - other, axis=1) / length_m - 1.0)
    off = float(abs(own.pose.baseline / truth.pose.baseline - 1.0) / MOST_BASELINE * MOST)
    stated = answer.recommendation.measure.length_p95.forecast
    if stated is None or not np.isfinite(stated.high):
        return off
    return float(max(np.nanpercentile(errors, 95) / stated.high, off))


def of_bars(row: str, number: int, name: str, __: Asked) -> tuple[str, str] | None:
    """A mistake in a kind of bars, or with no name a sound one, as one of the words."""
    kind = PAIRS[number % len(PAIRS)] if row == "pairs" else row
    mistake = OF_PAIRS.get(name)
    if mistake is not None and row == "pairs":
        kind = mistake.kinds[number % len(mistake.kinds)]
    error = None
    if mistake is None or mistake.change is not None:
        scene, data, _ = culprits.sound(kind, number, mistake.frames if mistake else None)
        own, rng = culprits.KINDS[kind], np.random.default_rng([number, 99])
        fresh = culprits.bars_of(own, scene.rig, rng, FURTHER_BARS)
        cameras = scene.rig.primary, scene.rig.secondary
        pixels = [camera.project(at) for camera, at in zip(cameras, fresh.points_m, strict=True)]
        ends = np.stack(pixels, axis=1).reshape(-1, 2, 2, 2)
        error = partial(error_of_files, scene.rig, ends, scene.bar_length_m)
    if mistake is None:
        return of_sound(said_of(lambda: data, error))
    return in_words(
        said_of(partial(mistake.data, number, kind), error), mistake.words, mistake.harmless
    )


def of_boards(row: str, number: int, name: str, asked: Asked) -> tuple[str, str] | None:
    """A mistake in boards, or with no name sound ones, a third of them with a baseline."""
    draw = board_pairs.wide_lens if row == "wide-boards" else board_pairs.lens
    if name not in OF_BOARDS:
        number += 1000
        pair = board_pairs.sound(number, asked.frames, number % 3 == 1, draw)
        return of_sound(said_of(lambda: pair.dataset, error_of_boards(pair)))
    mistake, rng = OF_BOARDS[name], np.random.default_rng([number, 5])
    pair = board_pairs.sound(number, asked.frames, mistake.measured, draw)
    said = said_of(partial(mistake.of_board, pair, rng), error_of_boards(pair))
    return in_words(said, mistake.words)


def error_of_boards(pair: BoardPair) -> Callable[[PairAnswer], float] | None:
    """`error_of_files` on the diagonals of further boards."""
    if pair.truth is None:
        return None
    rng, corners = np.random.default_rng(5), board_pairs.true_corners(pair.board, 0.0)
    far = float(np.median([pose.T[2] for pose in pair.placings]))
    placings = board_pairs.draw_placings(pair.truth, far, pair.board, rng, FURTHER_BOARDS)
    seen = [board_pairs.images_of(pair.truth, pose, corners) for pose in placings]
    ends = np.stack([each[[0, -1]] for each in seen if each is not None])
    length = float(np.linalg.norm(corners[-1] - corners[0]))
    return partial(error_of_files, pair.truth, ends, length)


def of_rigs(kind: str, number: int, name: str, __: Asked) -> tuple[str, str] | None:
    """A mistake in a rig; None of one that it cannot have."""
    if name == "0.3 frames late" and not several_cameras.KINDS[kind].waved:
        return None
    truth, _ = several_cameras.sound(kind, number)
    recording = OF_RIGS[name].of_rig(kind, number) if name in OF_RIGS else truth.recording
    word, text, found = by_command(recording)
    off = largest_z(found, truth.poses) if found else 0.0
    if name not in OF_RIGS:
        return ("nothing accused" if word == "silent" else "ACCUSED"), text
    return with_error(word, off) if found else word, f"{off:.1f} stated errors; {text}"


def by_command(recording: Recording) -> tuple[str, str, RigFile | None]:
    """What `stereocal rig` makes of a recording, as one word, what it says, and its file."""
    said, errors = io.StringIO(), io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "out"
        write(pack_recording(recording), Path(folder) / "rig")
        with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
            status = stereocal(["rig", str(Path(folder) / "rig"), "--out", str(out)])
        if status:
            files = "; FILES WRITTEN" if out.exists() else ""
            return f"refused{files}", errors.getvalue().strip().splitlines()[-1], None
        found = RigFile.load(out / RIG)
    notes = [line for line in said.getvalue().splitlines() if line.startswith("Note")]
    return "noted" if notes else "silent", " ".join(notes), found


def largest_z(found: RigFile, poses: Mapping[str, Pose]) -> float:
    """The largest of the rms errors of rotations over the stated ones, by camera."""
    errors, first = [0.0], poses[found.names[0]]
    for name in found.names[1:]:
        true = poses[name] @ first.inverse()
        error = Rotation.from_matrix(found.poses[name].R @ true.R.T).as_rotvec()
        sigma = np.array([found.standard_errors[name][key] for key in ROTATION])
        errors.append(rms(error / sigma))
    return max(errors)


def with_error(word: str, off: float) -> str:
    """The word of a rig's file whose error is so many times what it states."""
    if word == "noted":
        return "noted, not off" if off < MOST else "noted"
    return WRONG if off > MOST else RIGHT


def in_words(said: Said, words: tuple[str, ...], harmless: bool = False) -> tuple[str, str]:
    """The word of a recording with a mistake, and what was said."""
    return said.judged(words, harmless), f"{said.error or 0:.1f} times; {said.words[:300]}"


def of_sound(said: Said) -> tuple[str, str]:
    """The word of a sound recording."""
    off = "; FILES FAR OFF" if said.error is None or said.error > MOST else ""
    return ("ACCUSED" if said.accusations else "nothing accused") + off, str(said.accusations)


KINDS = {
    **dict.fromkeys(("pairs", "balls", "tags", "fisheyes"), (of_bars, OF_PAIRS)),
    **dict.fromkeys(("boards", "wide-boards"), (of_boards, OF_BOARDS)),
    **dict.fromkeys(several_cameras.KINDS, (of_rigs, OF_RIGS)),
}
"""By kind, what judges a mistake in it, and its mistakes."""


def each_kind(asked: Asked, sound: bool) -> None:
    """Print what became of each mistake in each kind, or of sound recordings."""
    every = (several_cameras.KINDS if kind == "rigs" else [kind] for kind in asked.kind or KINDS)
    for kind in chain.from_iterable(every):
        of, mistakes = KINDS[kind]
        total = Counter[str]()
        chosen = [name for name in mistakes if name in (asked.mistake or mistakes)]
        for name in ["nothing wrong"] if sound else chosen:
            found, begun, lines = Counter[str](), time.process_time(), list[str]()
            for number in asked.numbers:
                try:
                    told = of(kind, number, name, asked)
                except Exception:
                    told = TRACEBACK, traceback.format_exc()[-400:]
                if told is not None:
                    found[told[0]] += 1
                    lines.append(f"      {number}: {told[0]}: {told[1]}")
            words = ", ".join(f"{what} {count}" for what, count in found.items())
            print(f"  {kind}, {name}: {words} ({time.process_time() - begun:.0f} s)", flush=True)
            if asked.said or sound:
                print(*(line for line in lines if "nothing accused:" not in line), sep="\n")
            total += found
        print(f"  {kind}, all: {dict(total)}", flush=True)


def real(asked: Asked) -> None:
    """Each mistake in each part of real recordings."""
    if not asked.data:
        real_boards(asked)
    for name in asked.data:
        print(f"  {name}")
        try:
            data = pair_of(name)
        except StereocalError:  # it has more cameras
            recording = recording_of(name)
            for part in np.array_split(np.unique(recording.frame), asked.parts):
                real_rig(recording.where(np.isin(recording.frame, part)), asked)
        else:
            for part in np.array_split(data.correspondences.frames, asked.parts):
                real_pair(data.of_frames(part), asked)


def real_pair(data: Pair, asked: Asked) -> None:
    """Each kind of mistake in a recording of two cameras."""
    sound = PairAnswer(PairRun(data))
    truth = sound.sets[sound.recommendation.measure.method].pose
    sigma = float(np.sqrt(np.diag(sound.run.refined_set.covariance)[pose_places(1)][:3].sum()))

    def far(answer: PairAnswer) -> float:
        pose = answer.sets[answer.recommendation.measure.method].pose
        turn = Rotation.from_matrix(pose.R @ truth.R.T).magnitude() / sigma
        return float(max(turn, abs(pose.baseline / truth.baseline - 1.0) / FAR_BASELINE * MOST))

    print(f"  sound: {said_of(lambda: data, None).accusations or 'nothing accused'}")
    for name, mistake in OF_PAIRS.items():
        if mistake.change is not None and name in (asked.mistake or OF_PAIRS):
            changed = partial(mistake.of_pair, data.recording, np.random.default_rng(5))
            said = said_of(changed, far)
            _print_real(name, *in_words(said, mistake.words, mistake.harmless), asked)


def real_boards(asked: Asked) -> None:
    """OpenCV's sample, with each kind put into it but those that need the truth."""
    boards = boards_in(real_data() / "opencv_boards")
    cameras = cameras_of(boards, uncertainties(boards, SUBSET))
    recording = found_of(boards, cameras).recording
    (one, two), board = cameras.values(), recording.object.board
    assert board is not None
    images = recording.images()[1]
    print(f"  sound: {of_sound(said_of(lambda: recording.pair(*cameras), None))[1]}")
    for name, mistake in OF_BOARDS.items():
        if mistake.printed is None and name in (asked.mistake or OF_BOARDS):
            pair = BoardPair((one, two), board, images, 0.0997 if mistake.measured else None)
            said = said_of(partial(mistake.of_board, pair, np.random.default_rng([0, 5])), None)
            _print_real(name, *in_words(said, mistake.words), asked)


def real_rig(data: Recording, asked: Asked) -> None:
    """Each kind of mistake that needs no truth in a recording of three cameras and more."""

    def kind_of(note: str) -> str:
        return re.sub(r"[\d.]+", "#", note.partition(":")[0])

    usual, text, sound = by_command(data)
    print(f"  sound: {usual}; {text}", flush=True)
    assert sound is not None
    usual_notes = {*map(kind_of, text.split("Note: "))}
    for name, mistake in OF_RIGS.items():
        change = mistake.change
        if change is None or mistake.measured or name not in (asked.mistake or OF_RIGS):
            continue
        word, text, found = by_command(change(data, np.random.default_rng(5)))
        off = 0.0
        if found is not None:
            notes = [note for note in text.split("Note: ") if kind_of(note) not in usual_notes]
            text, off = " ".join(notes), np.inf
            if [*found.poses] == [*sound.poses]:
                lengths = [
                    abs(found.pair(*pair).pose.baseline / sound.pair(*pair).pose.baseline - 1.0)
                    for pair in combinations(sound.names, 2)
                ]
                off = max(largest_z(found, sound.poses), max(lengths) / FAR_BASELINE * MOST)
            word = with_error("noted" if notes else "silent", off)
        _print_real(name, word, f"{off:.1f} times; {text}", asked)


def _print_real(name: str, word: str, text: str, asked: Asked) -> None:
    print(f"    {name}: {word}, {text if asked.said else text.partition(';')[0]}", flush=True)


def frames(asked: Asked) -> None:
    """1, 2 and 3 of 25 frames exchanged in one camera: rotation error over the clean one's."""
    for count in (0, 1, 2, 3):
        refused = exact = sound_named = 0
        within: dict[Method, int] = {"2d": 0, "3d": 0}
        for number in asked.numbers:
            scene, data, rng = rig(number)
            clean = calibrate(data)
            spoiled, bad = with_frames_exchanged(data, rng, count)
            try:
                found = calibrate(spoiled)
            except StereocalError:
                refused += 1
                continue
            exact += found.screening.left_out == bad
            sound_named += len(set(found.screening.left_out) - set(bad))
            for method in within:
                limit = 1.5 * off_by(clean, scene, method) + np.radians(0.3)
                within[method] += off_by(found, scene, method) <= limit
        print(
            f"  {count} of 25: refused {refused}, exactly these named {exact} of {asked.trials}, "
            f"sound frames named {sound_named} of {asked.trials * (25 - count)}; within 1.5 times "
            f"+ 0.3 degrees: 2D {within['2d']}, 3D {within['3d']}"
        )


def points(asked: Asked) -> None:
    """30 % of the points off: right is a 2D rotation within twice the clean one's plus 0.5 degrees,
    and only bad frames left out."""
    counts = Counter[str]()
    for number in asked.numbers:
        scene, data, rng = rig(number)
        clean = calibrate(data)
        spoiled, bad = with_points_off(data, rng)
        try:
            found = calibrate(spoiled)
        except StereocalError:
            counts["refused"] += 1
            continue
        good = off_by(found, scene, "2d") <= 2.0 * off_by(clean, scene, "2d") + np.radians(0.5)
        good &= set(found.screening.left_out) <= set(bad)
        counts["right" if good else "wrong"] += 1
        counts["not to be relied on"] += bool(why_not_trusted(found))
    print(f"  of {asked.trials}: {dict(counts)}")


def off_by(run: CalibrationRun, scene: Scene, method: Method) -> float:
    """The rotation error of a set, rad."""
    return turned(run.methods[method].pose, scene.rig.pose)


STUDIES: dict[str, tuple[Study, int]] = {
    "wrong": (partial(each_kind, sound=False), 4),
    "sound": (partial(each_kind, sound=True), 20),
    "real": (real, 1),
    "frames": (frames, 40),
    "points": (points, 40),
}


if __name__ == "__main__":
    options = {"kind": [], "mistake": [], "data": [], "parts": 1, "frames": 20, "said": False}
    run_studies(STUDIES, __doc__, **options)
