"""Which target is A and which is B, so that both cameras of a frame agree.

Each photograph gives its two targets in the order along the bar (left to right, or top to bottom),
which the two cameras may see differently. The epipolar geometry that all frames share decides: with
the right labels both targets lie on the epipolar lines of their twins (`epipolar_labels`). To
exchange A and B in both cameras changes nothing.

Where the bar lies along an epipolar line both ways fit; then the length of the bar decides.
Where a photograph shows more boards than two, the frames that are sure tell which (`choosing`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import numpy.typing as npt

from stereocal.detection.detect import Detection
from stereocal.detection.fit import Corner
from stereocal.frames.choosing import SMALLEST_EXCESS_PX, choose_boards
from stereocal.frames.epipolar_labels import FEWEST_FRAMES, EpipolarLabels, compare_labels
from stereocal.refined.outliers import outlying
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import TARGETS

Truth = npt.NDArray[np.bool_]
FrameState = Literal["agreed", "swapped", "doubtful", "outlying", "unchecked", "refused"]

SAME_LENGTH, OTHER_LENGTH = 0.1, 0.3
"""Logarithms of the length of the bar against the median, with the right and the wrong labels."""


@dataclass(frozen=True)
class FrameLabels:
    """How sure the labels of one frame are."""

    frame: int
    state: FrameState
    """Agreed: order along the bar and epipolar geometry say the same. Swapped: the secondary's
    targets were exchanged. Doubtful: neither way is clearly right, or a detection is doubtful.
    Outlying: no way fits the other frames. Unchecked: too few frames. Refused: a photograph without
    targets, or none."""
    residual_px: float
    """Distance of the targets from their epipolar lines, root mean square; NaN where unknown."""
    swapped_px: float
    """The same with the other labels."""
    sentence: str


@dataclass(frozen=True, eq=False)
class LabelledPair:
    """One target of one frame in both cameras."""

    frame: int
    target: str
    """A or B."""
    primary: Corner
    secondary: Corner
    sure: bool
    """Both detections and the labels of the frame are sure."""


@dataclass(frozen=True, eq=False)
class Labelling:
    """The targets of all frames, A and B told apart, and a report for every frame."""

    pairs: tuple[LabelledPair, ...]
    frames: tuple[FrameLabels, ...]


def label_targets(
    primary: Mapping[int, Detection],
    secondary: Mapping[int, Detection],
    cameras: tuple[Camera, Camera],
    seed: int = 0,
) -> Labelling:
    """Make the labels of the two cameras agree, and choose among boards where there are too many.

    Args:
        primary, secondary: detections by frame number.
        cameras: of the primary and the secondary.

    No frame is left out: one without two targets in each camera has a report and no pairs.
    """
    labelling = _labelled(primary, secondary, cameras, seed)
    open_frames = {
        frame: (primary[frame], secondary[frame])
        for frame in primary.keys() & secondary.keys()
        if primary[frame].alternatives or secondary[frame].alternatives
    }
    if not open_frames:
        return labelling
    sure = np.array([[p.primary.centre, p.secondary.centre] for p in labelling.pairs if p.sure])
    chosen = choose_boards(sure.reshape(-1, 2, 2, 2), open_frames, cameras)
    first = {**primary, **{frame: one.primary for frame, one in chosen.items()}}
    second = {**secondary, **{frame: one.secondary for frame, one in chosen.items()}}
    labelling = _labelled(first, second, cameras, seed)
    said = {frame: one.sentence for frame, one in chosen.items()}
    reports = [
        replace(one, sentence=f"{one.sentence} {said.get(one.frame, '')}".strip())
        for one in labelling.frames
    ]
    return Labelling(labelling.pairs, tuple(reports))


def _labelled(
    primary: Mapping[int, Detection],
    secondary: Mapping[int, Detection],
    cameras: tuple[Camera, Camera],
    seed: int,
) -> Labelling:
    corners = {
        frame: (first, second)
        for frame in sorted(primary.keys() & secondary.keys())
        if (first := primary[frame].targets) and (second := secondary[frame].targets)
    }
    rays = [_rays(cameras[i], [both[i] for both in corners.values()]) for i in range(2)]
    focal = float(np.mean([np.sqrt(c.K[0, 0] * c.K[1, 1]) for c in cameras]))
    labels = compare_labels(rays[0], rays[1], focal, np.random.default_rng(seed))
    decided = dict(zip(corners, _decide(list(corners), labels), strict=True))
    pairs, reports = [], []
    for frame in sorted(primary.keys() | secondary.keys()):
        if frame not in corners:
            reports.append(_refused(frame, primary.get(frame), secondary.get(frame)))
            continue
        exchange, report = decided[frame]
        first, second = corners[frame]
        reports.append(_with_doubts(report, primary[frame], secondary[frame]))
        sure = reports[-1].state in ("agreed", "swapped")
        pairs += [
            LabelledPair(frame, target, p, s, sure)
            for target, p, s in zip(
                TARGETS, first, second[::-1] if exchange else second, strict=True
            )
        ]
    return Labelling(tuple(pairs), tuple(reports))


def _rays(camera: Camera, targets: list[tuple[Corner, Corner]]) -> FloatArray:
    """(f, 2, 2): normalised points of both targets of each frame."""
    centres = np.array([corner.centre for both in targets for corner in both]).reshape(-1, 2)
    return camera.undistort(centres).reshape(-1, 2, 2)


def _decide(frames: list[int], labels: EpipolarLabels | None) -> list[tuple[bool, FrameLabels]]:
    """For each frame whether the secondary's targets are to be exchanged, and the report."""
    if labels is None:
        why = "A and B are in the order along the bar; "
        if len(frames) < FEWEST_FRAMES:
            why += f"{FEWEST_FRAMES} frames or more are needed to check them."
        else:
            why += "the points do not determine how the cameras stand, to check them."
        return [(False, FrameLabels(f, "unchecked", np.nan, np.nan, why)) for f in frames]
    least = labels.residual_px.min(axis=1)
    # A frame fits up to where the next would stand out.
    far = outlying(least, SMALLEST_EXCESS_PX)
    limit = float(least[~far].max(initial=0.0)) + SMALLEST_EXCESS_PX
    better = labels.residual_px[:, 1] < labels.residual_px[:, 0]
    clear = labels.residual_px.max(axis=1) > 2.0 * limit
    usual = _usual_length(labels, better, clear & ~far)
    decided = []
    for i, frame in enumerate(frames):
        by_length = None if clear[i] else _by_length(labels.length[i], usual)
        exchange = bool(better[i]) if clear[i] else bool(by_length)
        state, sentence = _state(bool(far[i]), bool(clear[i]), by_length, exchange)
        if not labels.unique and state in ("agreed", "swapped"):
            state, sentence = "doubtful", "Other labels of A and B fit all frames nearly as well."
        kept, other = labels.residual_px[i][:: -1 if exchange else 1]
        decided.append((exchange, FrameLabels(frame, state, float(kept), float(other), sentence)))
    return decided


def _state(
    far: bool, clear: bool, by_length: bool | None, exchange: bool
) -> tuple[FrameState, str]:
    """The state of a frame, and what a person should know."""
    if far:
        return "outlying", "Its targets do not lie on the epipolar lines of the other frames."
    if not clear and by_length is None:
        return "doubtful", (
            "The bar lies along the epipolar lines, so that A and B cannot be told apart by them."
        )
    if exchange:
        return "swapped", "A and B of the secondary were exchanged."
    return "agreed", ""


def _usual_length(labels: EpipolarLabels, better: Truth, use: Truth) -> float:
    """Median length of the bar over the frames whose labels are clear; NaN without any."""
    length = np.where(better, labels.length[:, 1], labels.length[:, 0])[use]
    length = length[np.isfinite(length)]
    return float(np.median(length)) if len(length) else np.nan


def _by_length(length: FloatArray, usual: float) -> bool | None:
    """Whether the length of the bar wants the labels exchanged; None where it does not tell."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.log(length / usual))
    off = np.where(np.isnan(off), np.inf, off)
    if off.min() < SAME_LENGTH and off.max() > OTHER_LENGTH:
        return bool(off[1] < off[0])
    return None


def _with_doubts(report: FrameLabels, first: Detection, second: Detection) -> FrameLabels:
    """The report with what is doubtful of the detections."""
    doubts = [
        f"In the {name}: {detection.sentence}"
        for name, detection in (("primary", first), ("secondary", second))
        if detection.state == "doubtful"
    ]
    if not doubts:
        return report
    state = "doubtful" if report.state in ("agreed", "swapped") else report.state
    sentence = " ".join([report.sentence, *doubts]).strip()
    return replace(report, state=state, sentence=sentence)


def _refused(frame: int, first: Detection | None, second: Detection | None) -> FrameLabels:
    """The report of a frame that lacks targets."""
    why = []
    for name, detection in (("primary", first), ("secondary", second)):
        if detection is None:
            why.append(f"There is no photograph of the {name}.")
        elif detection.targets is None:
            why.append(f"In the {name}: {detection.sentence}")
    return FrameLabels(frame, "refused", np.nan, np.nan, " ".join(why))
