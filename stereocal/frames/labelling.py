"""Label the targets A and B consistently in both cameras of a frame.

Detection orders the two targets of a photograph left to right or top to bottom; the cameras may
differ. With the right labels both targets lie on their epipolar lines (`epipolar_labels`);
exchanging A and B in both cameras changes nothing. If the bar lies along an epipolar line, both
labellings fit and the length of the bar decides. If a photograph shows more than two boards, the
unambiguous frames decide which are the targets (`choosing`).
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
from stereocal.frames.epipolar_labels import (
    MINIMUM_FRAMES,
    EpipolarLabels,
    compare_labels,
    frame_focal_px,
)
from stereocal.refined.outliers import outlying
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import TARGETS

Truth = npt.NDArray[np.bool_]
FrameState = Literal["agreed", "swapped", "doubtful", "outlying", "unchecked", "refused"]

SAME_LENGTH, OTHER_LENGTH = 0.1, 0.3
"""Limits of |log(length / median)|, with the right and with the wrong labels."""


@dataclass(frozen=True)
class FrameLabels:
    """The report on the labels of one frame."""

    frame: int
    state: FrameState
    """Agreed: the detected order fits the epipolar geometry. Swapped: the secondary's targets were
    exchanged. Doubtful: neither labelling is clearly right, or a detection is doubtful. Outlying:
    neither fits the other frames. Unchecked: too few frames. Refused: a photograph is missing or
    shows no targets."""
    residual_px: float
    """Distance of the targets from their epipolar lines, root mean square; NaN if unknown."""
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
    """The labelled targets of all frames, and a report on every frame."""

    pairs: tuple[LabelledPair, ...]
    frames: tuple[FrameLabels, ...]


def label_targets(
    primary: Mapping[int, Detection],
    secondary: Mapping[int, Detection],
    cameras: tuple[Camera, Camera],
    seed: int = 0,
) -> Labelling:
    """Make the labels of both cameras agree; where there are too many boards, choose the targets.

    Args:
        primary, secondary: detections by frame number.

    Every frame has a report; one without two targets in each camera has no pairs.
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
    messages = {frame: one.sentence for frame, one in chosen.items()}
    reports = [
        replace(one, sentence=f"{one.sentence} {messages.get(one.frame, '')}".strip())
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
    focal = frame_focal_px(cameras, rays)
    labels = compare_labels(rays[0], rays[1], focal, np.random.default_rng(seed))
    decided = dict(zip(corners, decide_labels(list(corners), labels), strict=True))
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


def decide_labels(
    frames: list[int], labels: EpipolarLabels | None
) -> list[tuple[bool, FrameLabels]]:
    """For each frame, whether to exchange the secondary's targets, and the report."""
    if labels is None:
        why = "A and B are in the order along the bar and could not be checked: "
        if len(frames) < MINIMUM_FRAMES:
            why += f"this needs at least {MINIMUM_FRAMES} frames."
        else:
            why += "the points do not determine the pose of the cameras."
        return [(False, FrameLabels(f, "unchecked", np.nan, np.nan, why)) for f in frames]
    least = labels.residual_px.min(axis=1)
    # A frame fits up to the residual where it would count as an outlier.
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
    """The state of a frame, and the message for the user."""
    if far:
        return "outlying", "Its targets do not lie on the epipolar lines of the other frames."
    if not clear and by_length is None:
        return "doubtful", (
            "The bar lies along the epipolar lines, so they cannot distinguish A and B."
        )
    if exchange:
        return "swapped", "A and B of the secondary were exchanged."
    return "agreed", ""


def _usual_length(labels: EpipolarLabels, better: Truth, use: Truth) -> float:
    """Median length of the bar over the frames with clear labels; NaN if there are none."""
    length = np.where(better, labels.length[:, 1], labels.length[:, 0])[use]
    length = length[np.isfinite(length)]
    return float(np.median(length)) if len(length) else np.nan


def _by_length(length: FloatArray, usual: float) -> bool | None:
    """Whether the length of the bar requires exchanged labels; None if inconclusive."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.log(length / usual))
    off = np.where(np.isnan(off), np.inf, off)
    if off.min() < SAME_LENGTH and off.max() > OTHER_LENGTH:
        return bool(off[1] < off[0])
    return None


def _with_doubts(report: FrameLabels, first: Detection, second: Detection) -> FrameLabels:
    """The report with the doubts about the detections added."""
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
