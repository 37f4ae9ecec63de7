"""Which object is proposed: `python -m benchmarks.held [KIND ...] [--trials N]`.

Renders bars, balls, tags, chessboards and ChArUco boards (`tools.photographs.objects`, which knows
nothing of the proposal), each before clutter with objects of the other kinds that do not move.
"""

from collections import Counter
from functools import partial

import cv2
import numpy as np

from benchmarks.studies import run_studies
from stereocal.intrinsics.held_object import HeldObject, held_object
from tools.photographs.balls import ColourPhotograph
from tools.photographs.objects import HELD_BOARD, KINDS, TAG_IDS, Kind, photographs_of


def outcome(kind: Kind, held: HeldObject | None) -> str:
    """Right, undecided, or what is proposed instead."""
    if held is None:
        return "undecided"
    if kind in ("board", "charuco"):
        right = held.words.split(" with ")[0] in ("a chessboard", "a ChArUco board")
        right &= (kind == "charuco") == ("ChArUco" in held.words)
        right &= f"{HELD_BOARD} inner" in held.words
    elif kind == "tags":
        right = held.words.endswith(f"tags {TAG_IDS[0]} and {TAG_IDS[1]} of 4X4_50")
    else:
        right = held.kind == kind
    return "right" if right else held.words


def encoded(image: ColourPhotograph) -> bytes:
    """The photograph as a PNG."""
    return cv2.imencode(".png", image)[1].tobytes()


def study(kind: Kind, trials: int) -> None:
    """Print how often an object is proposed."""
    counts: Counter[str] = Counter()
    for trial in range(trials):
        rng = np.random.default_rng([KINDS.index(kind), trial])
        photographs = photographs_of(kind, rng)
        held = held_object([{n: encoded(i) for n, i in own.items()} for own in photographs])
        counts[outcome(kind, held)] += 1
    print(f"  {kind}: {dict(counts)}", flush=True)


if __name__ == "__main__":
    cv2.setNumThreads(1)
    run_studies({kind: (partial(study, kind), 100) for kind in KINDS}, __doc__)
