"""Find the labels of the bar's targets that agree with one epipolar geometry of all frames.

With the right labels both targets lie on their epipolar lines; exchanging A and B in both cameras
changes nothing. If the bar lies along an epipolar line, both labellings fit and the length of the
bar decides.

The geometry is estimated without known labels: samples of four frames, each labelled in all 16
ways, give candidates (8-point). Those with the least median residual over all frames (least median
of squares: Rousseeuw, 1984, J. Am. Stat. Assoc. 79, 871) are refined on the frames that fit them.
"""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from stereocal.calibration.essential import calibrate_essential, linear_essential
from stereocal.errors import StereocalError
from stereocal.fit.screening.outliers import outlying
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import contiguous
from stereocal.rig.geometry import Pose, sampson, triangulate_rays
from stereocal.system.array_types import FloatArray

MINIMUM_FRAMES = 6
"""12 pairs for 5 angles: with fewer, wrong labels can fit as well."""
SAMPLED_FRAMES = 4
SAMPLES = 40
REFINED = 8
"""Number of the best samples to refine."""
KEPT = 0.7
"""Fraction of the frames, those that fit best, that a refinement uses."""
MAXIMUM_SCORED = 200
"""Frames used to score a sample."""
RUNNER_UP = 3.0
"""The labels are ambiguous if others fit to within this factor."""
NO_POSE_PX = 10.0
"""Frames that fit one pose to this only are not of one rig: 0.2 px measured with sound pairs, 440
with one photograph missing."""
NO_WORSE_PX = 0.05
"""Smaller differences between residuals are ignored."""
SMALLEST_EXCESS_PX = 0.15
"""Smaller deviations never make a frame an outlier or rule out labels or boards."""
SAME_LENGTH, OTHER_LENGTH = 0.1, 0.3
"""Limits of |log(length / median)|, with the right and with the wrong labels."""
FrameState = Literal["agreed", "swapped", "doubtful", "outlying", "unchecked"]


@dataclass(frozen=True, eq=False)
class FrameLabels:
    """The report on the labels of one frame."""

    state: FrameState
    """Agreed: the detected order fits the epipolar geometry. Swapped: the secondary's targets were
    exchanged. Doubtful: neither labelling is clearly right. Outlying: neither fits the other
    frames. Unchecked: too few frames."""
    residual_px: float
    """Distance of the targets from their epipolar lines, root mean square; NaN if unknown."""
    swapped_px: float
    """The same with the other labels."""
    sentence: str

    @property
    def is_sure(self) -> bool:
        """Whether A and B are told apart."""
        return self.state in ("agreed", "swapped")


def decide_labels(
    centres: Mapping[int, FloatArray], cameras: tuple[Camera, Camera], seed: int = 0
) -> dict[int, tuple[bool, FrameLabels]]:
    """Whether to exchange the secondary's targets, and the report, by frame.

    Args:
        centres: by frame (2, 2, 2): raw pixels by camera, target, (u, v).
    """
    frames = list(centres)
    pixels = np.array([centres[frame] for frame in frames]).reshape(-1, 2, 2, 2)
    rays = [
        camera.undistort(pixels[:, i].reshape(-1, 2)).reshape(-1, 2, 2)
        for i, camera in enumerate(cameras)
    ]
    focal = frame_focal_px(cameras, rays)
    compared = _compare(rays[0], rays[1], focal, np.random.default_rng(seed))
    if compared is None:
        why = "A and B are in the order along the bar and could not be checked: "
        if len(frames) < MINIMUM_FRAMES:
            why += f"this needs at least {MINIMUM_FRAMES} frames."
        else:
            why += "the points do not determine the pose of the cameras."
        return {f: (False, FrameLabels("unchecked", np.nan, np.nan, why)) for f in frames}
    residual_px, lengths, unique = compared
    least = residual_px.min(axis=1)
    # A frame fits up to the residual where it would count as an outlier.
    far = outlying(least, SMALLEST_EXCESS_PX)
    limit = float(least[~far].max(initial=0.0)) + SMALLEST_EXCESS_PX
    better = residual_px[:, 1] < residual_px[:, 0]
    clear = residual_px.max(axis=1) > 2.0 * limit
    length = np.where(better, lengths[:, 1], lengths[:, 0])[clear & ~far]
    length = length[np.isfinite(length)]
    usual = float(np.median(length)) if len(length) else np.nan
    decided = {}
    for i, frame in enumerate(frames):
        by_length = None if clear[i] else _by_length(lengths[i], usual)
        exchange = bool(better[i]) if clear[i] else bool(by_length)
        state: FrameState = "swapped" if exchange else "agreed"
        sentence = "A and B of the secondary were exchanged." if exchange else ""
        if far[i]:
            state = "outlying"
            sentence = "Its targets do not lie on the epipolar lines of the other frames."
        elif not clear[i] and by_length is None:
            state = "doubtful"
            sentence = _undecided(limit)
        elif not unique:
            state = "doubtful"
            sentence = "Other labels of A and B fit all frames nearly as well."
        kept, other = residual_px[i][:: -1 if exchange else 1]
        report = FrameLabels(state, float(kept), float(other), sentence)
        decided[frame] = exchange, report
    return decided


def _undecided(limit: float) -> str:
    """Why A and B cannot be distinguished, by the residual (px) up to which frames fit."""
    if limit < NO_POSE_PX:
        return "The bar lies along the epipolar lines, so they cannot distinguish A and B."
    return (
        f"The frames fit one pose of the cameras to {limit:.0f} px only, which cannot distinguish "
        "A and B: are both photographs of the same moment?"
    )


def _by_length(length: FloatArray, usual: float) -> bool | None:
    """Whether the length of the bar requires exchanged labels; None if inconclusive."""
    with np.errstate(invalid="ignore", divide="ignore"):
        off = np.abs(np.log(length / usual))
    off = np.where(np.isnan(off), np.inf, off)
    if off.min() < SAME_LENGTH and off.max() > OTHER_LENGTH:
        return bool(off[1] < off[0])
    return None


def _compare(
    primary: FloatArray, secondary: FloatArray, focal_px: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, bool] | None:
    """Compare both labellings of each frame; None if too few frames, or no geometry fits.

    Args:
        primary, secondary: (f, 2, 2): normalised points by frame, target, (x, y).
        focal_px: (f,), converts residuals to pixels.

    Returns:
        Sampson distances in px, RMS over both targets, and lengths of the bar per baseline, NaN
        behind a camera, (f, 2) with the labels as they are and exchanged; and whether no other
        labels fit nearly as well.
    """
    if len(primary) < MINIMUM_FRAMES:
        return None
    rays = both_ways(primary, secondary)
    poses = []
    for pose in fitting_poses(rays, rng):
        residual = focal_px * distances(pose.essential, rays)
        poses.append((float(np.median(residual.min(axis=0))), pose, residual))
    if not poses:
        return None
    poses.sort(key=lambda scored: scored[0])
    least, pose, residual = poses[0]
    swapped = residual[1] < residual[0]
    unique = True
    for other, _, residual_px in poses[1:]:
        differs = (residual_px[1] < residual_px[0]) != swapped
        # Frames where both labellings fit may differ: the bar lies along an epipolar line.
        clear = residual.max(axis=0) > RUNNER_UP * least + NO_WORSE_PX
        if (differs & clear).any() and other < RUNNER_UP * least + NO_WORSE_PX:
            unique = False
    ends = [triangulate_rays(pose.R, pose.T, way.reshape(-1, 4).T.copy()) for way in rays]
    lengths = [np.linalg.norm(points[::2] - points[1::2], axis=1) for points in ends]
    return residual.T, np.column_stack(lengths), unique


def both_ways(primary: FloatArray, secondary: FloatArray) -> FloatArray:
    """(2, f, 2, 4): labelling, frame, target, x and y of both cameras, of points (f, 2, 2)."""
    ways = secondary, secondary[:, ::-1]
    return np.stack([np.concatenate([primary, way], axis=2) for way in ways])


def fitting_poses(
    rays: FloatArray, rng: np.random.Generator, samples: int = SAMPLES, most: int = REFINED
) -> list[Pose]:
    """At most so many poses that fit most frames of `both_ways`, in either labelling of each."""
    poses = (refined_pose(E, rays) for E in _samples(rays, rng, samples)[:most])
    return [pose for pose in poses if pose is not None]


def frame_focal_px(cameras: Sequence[Camera], rays: Sequence[FloatArray]) -> FloatArray:
    """(f,): pixels per unit of the plane z = 1 around the points (f, 2, 2) of both cameras."""
    focal_px = [
        camera.local_focal_px(points.reshape(-1, 2)).reshape(-1, 2)
        for camera, points in zip(cameras, rays, strict=True)
    ]
    return np.asarray(np.concatenate(focal_px, axis=1).mean(axis=1))


def _samples(rays: FloatArray, rng: np.random.Generator, samples: int) -> list[FloatArray]:
    """Essential matrices of the samples with the least median residual, best first."""
    frames = rays.shape[1]
    scored = rays[:, rng.permutation(frames)[:MAXIMUM_SCORED]]
    matrices = []
    ways = [np.array(way) for way in itertools.product((0, 1), repeat=SAMPLED_FRAMES)]
    for _ in range(samples):
        chosen = rng.permutation(frames)[:SAMPLED_FRAMES]
        matrices += [
            linear_essential(contiguous(rays[way, chosen].reshape(-1, 4).T)) for way in ways
        ]
    sampled = np.array([E for E in matrices if np.isfinite(E).all()]).reshape(-1, 3, 3)
    # All at once, which takes a tenth of the time.
    medians = np.median(distances(sampled, scored).min(axis=-2), axis=-1)
    return list(sampled[np.argsort(medians, kind="stable")])


def refined_pose(E: FloatArray, rays: FloatArray) -> Pose | None:
    """The pose fitted to the best-fitting frames and labels, as in least trimmed squares until the
    selection no longer changes; None if undetermined."""
    frames = rays.shape[1]
    most = max(MINIMUM_FRAMES - 1, round(KEPT * frames))
    pose: Pose | None = None
    before: tuple[bytes, bytes] | None = None
    for _ in range(10):
        distance = distances(E, rays)
        way = np.argmin(distance, axis=0)
        kept = np.sort(np.argsort(distance.min(axis=0), kind="stable")[:most])
        now = (way[kept].tobytes(), kept.tobytes())
        if now == before:
            break
        before = now
        chosen = rays[way[kept], kept].reshape(-1, 4).T.copy()
        try:
            pose = calibrate_essential(chosen, 1.0).pose
        except StereocalError:
            return None
        E = pose.essential
    return pose


def distances(E: FloatArray, rays: FloatArray) -> FloatArray:
    """(2, f): Sampson distances, root mean square over the targets of a frame, normalised units; of
    matrices (k, 3, 3), (k, 2, f)."""
    return np.asarray(np.sqrt((sampson(E, rays) ** 2).mean(axis=-1)))
