"""What is said of a recording with one thing wrong, and how far off its files are."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun

MOST, MOST_BASELINE = 3.0, 0.05
"""A file is wrong if its 95 % length error is more than so many times what it states, or its
baseline off by more than such a share."""
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


@dataclass(frozen=True)
class Said:
    """What was said of a recording, and its files' error over the stated one; None without."""

    words: str
    is_refused: bool
    accusations: tuple[str, ...]
    error: float | None = None
    is_cautioned: bool = False


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
        return Said(str(found).lower(), True, (str(found),))
    accusing = tuple(note for note in notes if note and not note.startswith(ALWAYS))
    caution = bool(answer.recommendation.caution)
    return Said(" ".join(notes).lower(), False, accusing, of_files, caution)


def error_of_files(answer: PairAnswer, truth: Rig, ends: FloatArray, length_m: float) -> float:
    """The true 95 % length error of the file to measure with, over the upper end of the stated; at
    least the error of its baseline over `MOST_BASELINE`, times `MOST`.

    Args:
        ends: (n, 2, 2, 2): by bar and end, the pixels in both cameras.
        length_m: of the bars.
    """
    file = answer.sets[answer.recommendation.measure.method]
    rig = Rig(file.primary, file.secondary, file.pose)
    with np.errstate(invalid="ignore"):
        one, other = (rig.reconstruct(ends[:, k, 0], ends[:, k, 1]) for k in (0, 1))
    errors = np.abs(np.linalg.norm(one - other, axis=1) / length_m - 1.0)
    off = float(abs(rig.pose.baseline / truth.pose.baseline - 1.0) / MOST_BASELINE * MOST)
    stated = answer.recommendation.measure.length_p95.forecast
    if stated is None or not np.isfinite(stated.high):
        return off
    return float(max(np.nanpercentile(errors, 95) / stated.high, off))


def judged(said: Said, words: tuple[str, ...]) -> str:
    """What became of a recording with a mistake that any of the words names."""
    named = any(word.lower() in said.words for word in words)
    if said.is_refused:
        return REFUSED if named else OTHER
    if named:
        return WARNED if said.is_cautioned else NOTED
    return RIGHT if said.error is not None and said.error < MOST else WRONG


def in_words(found: Counter[str]) -> str:
    """How many of each."""
    return ", ".join(f"{what} {number}" for what, number in found.items())
