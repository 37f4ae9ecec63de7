"""Photographs with more than two boards: what the other frames decide, right or wrong.

python -m benchmarks.choosing [--series 8] [--frames 18] [--seed 5]

Five kinds of series of small photographs, each frame judged without and with the other frames:

- clutter: rectangles, crosses and lines behind the bar, some nearly like a board;
- second board: a board like the targets stands in the scene, seen by both cameras;
- on the line: that board is, in each frame, on the epipolar line of a target;
- at its length: that board is, in each frame, as far from target A as B is;
- hidden: as the second, and in some frames the secondary does not show target B at all.
"""

from collections import Counter
from dataclasses import replace

import cv2
import numpy as np

from benchmarks.clutter import Found, Truth, labelled
from benchmarks.studies import numbers_asked
from benchmarks.third_boards import small_rig, taken
from stereocal.detection.detect import Detection, detect_targets
from stereocal.frames.frame import Frame

KINDS = ("clutter", "second board", "on the line", "at its length", "hidden")


def series(kind: str, frames: int, rng: np.random.Generator) -> tuple[Found, Truth]:
    """The detections of one series, and where the targets are."""
    found: Found = ({}, {})
    truth: Truth = {}
    for pair in taken(kind, frames, rng):
        truth[pair.frame] = (pair.centres_primary, pair.centres_secondary)
        for which, image in enumerate((pair.primary, pair.secondary)):
            found[which][pair.frame] = detect_targets(image)
    return found, truth


def judged(labelling: list[Frame], truth: Truth) -> Counter[str]:
    """How many frames are right and sure, wrong and sure, in doubt with the right targets or with
    others, refused."""
    counts: Counter[str] = Counter()
    for report in labelling:
        if report.state == "refused":
            counts["refused"] += 1
            continue
        places, expected = report.places, np.stack(truth[report.frame], axis=1)
        off = min(np.abs(places - expected).max(), np.abs(places - expected[::-1]).max())
        counts[("right" if off < 1.0 else "wrong") + ("" if report.use else ", doubtful")] += 1
    return counts


def without_the_others(found: Found) -> Found:
    """The detections without their choices: nothing is left for the other frames."""

    def of(one: dict[int, Detection]) -> dict[int, Detection]:
        return {frame: replace(detection, alternatives=()) for frame, detection in one.items()}

    return of(found[0]), of(found[1])


def main() -> None:
    """Measure and print."""
    cv2.setNumThreads(1)
    asked = numbers_asked(__doc__, series=8, frames=18, seed=5)
    rig = small_rig()
    cameras = (rig.primary, rig.secondary)
    for at, kind in enumerate(KINDS):
        before: Counter[str] = Counter()
        after: Counter[str] = Counter()
        asked_of = 0
        why: Counter[str] = Counter()
        for number in range(asked.series):
            rng = np.random.default_rng([asked.seed, at, number])
            found, truth = series(kind, asked.frames, rng)
            bare = without_the_others(found)
            before += judged(labelled(bare, cameras), truth)
            labelling = labelled(found, cameras)
            after += judged(labelling, truth)
            for report in labelling:
                if any(found[i][report.frame].alternatives for i in range(2)):
                    asked_of += 1
                    why[f"{report.state}: {report.reason}"[-90:]] += 1
        print(f"{kind}: {asked_of} of {asked.series * asked.frames} frames with choices")
        print(f"  without the others {dict(before)}")
        print(f"  with them          {dict(after)}")
        print(*(f"    {count} {said}" for said, count in why.most_common(8)), sep="\n", flush=True)


if __name__ == "__main__":
    main()
