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
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.compiled import FloatArray

FrameState = Literal["agreed", "swapped", "doubtful", "outlying", "unchecked", "refused"]

SAME_LENGTH, OTHER_LENGTH = 0.1, 0.3
"""Limits of |log(length / median)|, with the right and with the wrong labels."""


@dataclass(frozen=True, eq=False)
class FrameLabels:
    """The targets of one frame, and the report on their labels."""

    frame: int
    state: FrameState
    """Agreed: the detected order fits the epipolar geometry. Swapped: the secondary's targets were
    exchanged. Doubtful: neither labelling is clearly right, or a detection is doubtful. Outlying:
    neither fits the other frames. Unchecked: too few frames. Refused: a photograph shows no
    targets."""
    residual_px: float
    """Distance of the targets from their epipolar lines, root mean square; NaN if unknown."""
    swapped_px: float
    """The same with the other labels."""
    sentence: str
    targets: tuple[tuple[Corner, Corner], tuple[Corner, Corner]] | None = None
    """A and B in either camera; None if a photograph shows none."""

    @property
    def is_sure(self) -> bool:
        """Whether both detections and the labels are."""
        return self.state in ("agreed", "swapped")

    @property
    def places(self) -> FloatArray:
        """(2, 2, 2): raw pixels by target, camera, (u, v)."""
        sides = self.targets or ()
        return np.array([[corner.centre for corner in own] for own in sides]).swapaxes(0, 1)


def label_targets(
    seen: Mapping[int, tuple[Detection, Detection]], cameras: tuple[Camera, Camera], seed: int = 0
) -> list[FrameLabels]:
    """Make the labels of both cameras agree; where there are too many boards, choose the targets.

    Args:
        seen: the detections of both cameras by frame number.

    Returns:
        A report for each frame, by their numbers.
    """
    reports = _labelled(seen, cameras, seed)
    open_frames = {
        frame: both for frame, both in seen.items() if both[0].alternatives or both[1].alternatives
    }
    if not open_frames:
        return reports
    sure = np.array([report.places for report in reports if report.is_sure])
    chosen = choose_boards(sure.reshape(-1, 2, 2, 2), open_frames, cameras)
    decided = {frame: (one.primary, one.secondary) for frame, one in chosen.items()}
    return [
        replace(report, sentence=f"{report.sentence} {chosen[report.frame].sentence}".strip())
        if report.targets and report.frame in chosen
        else report
        for report in _labelled({**seen, **decided}, cameras, seed)
    ]


def _labelled(
    seen: Mapping[int, tuple[Detection, Detection]], cameras: tuple[Camera, Camera], seed: int
) -> list[FrameLabels]:
    corners = {
        frame: (first.targets, second.targets)
        for frame, (first, second) in sorted(seen.items())
        if first.targets and second.targets
    }
    rays = []
    for i, camera in enumerate(cameras):
        centres = [corner.centre for both in corners.values() for corner in both[i]]
        rays.append(camera.undistort(np.array(centres).reshape(-1, 2)).reshape(-1, 2, 2))
    focal = frame_focal_px(cameras, rays)
    labels = compare_labels(rays[0], rays[1], focal, np.random.default_rng(seed))
    decided = dict(zip(corners, decide_labels(list(corners), labels), strict=True))
    reports = []
    for frame, found in sorted(seen.items()):
        both = tuple(zip(CAMERAS, found, strict=True))
        if frame not in corners:
            why = (
                one.sentence
                if one.reason == "unreadable"
                else f"{camera.capitalize()}: {one.sentence}"
                for camera, one in both
                if one.sentence
            )
            reports.append(FrameLabels(frame, "refused", np.nan, np.nan, " ".join(why)))
            continue
        exchange, report = decided[frame]
        first, second = corners[frame]
        doubts = [
            f"In the {camera}: {one.sentence}" for camera, one in both if one.state == "doubtful"
        ]
        reports.append(
            replace(
                report,
                state="doubtful" if doubts and report.is_sure else report.state,
                sentence=" ".join([report.sentence, *doubts]).strip(),
                targets=(first, second[::-1] if exchange else second),
            )
        )
    return reports


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
    length = np.where(better, labels.length[:, 1], labels.length[:, 0])[clear & ~far]
    length = length[np.isfinite(length)]
    usual = float(np.median(length)) if len(length) else np.nan
    decided = []
    for i, frame in enumerate(frames):
        by_length = None if clear[i] else _by_length(labels.length[i], usual)
        exchange = bool(better[i]) if clear[i] else bool(by_length)
        state: FrameState = "swapped" if exchange else "agreed"
        sentence = "A and B of the secondary were exchanged." if exchange else ""
        if far[i]:
            state = "outlying"
            sentence = "Its targets do not lie on the epipolar lines of the other frames."
        elif not clear[i] and by_length is None:
            state = "doubtful"
            sentence = "The bar lies along the epipolar lines, so they cannot distinguish A and B."
        elif not labels.unique:
            state = "doubtful"
            sentence = "Other labels of A and B fit all frames nearly as well."
        kept, other = labels.residual_px[i][:: -1 if exchange else 1]
        decided.append((exchange, FrameLabels(frame, state, float(kept), float(other), sentence)))
    return decided


def _by_length(length: FloatArray, usual: float) -> bool | None:
    """Whether the length of the bar requires exchanged labels; None if inconclusive."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.log(length / usual))
    off = np.where(np.isnan(off), np.inf, off)
    if off.min() < SAME_LENGTH and off.max() > OTHER_LENGTH:
        return bool(off[1] < off[0])
    return None
