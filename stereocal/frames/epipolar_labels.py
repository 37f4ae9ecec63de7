"""Find the labels of the bar's targets that agree with one epipolar geometry of all frames.

The geometry is estimated without known labels: samples of four frames, each labelled in all 16
ways, give candidates (8-point). Those with the least median residual over all frames (least median
of squares: Rousseeuw, 1984, J. Am. Stat. Assoc. 79, 871) are refined on the frames that fit them.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereocal.calibration.essential import calibrate_essential, linear_essential
from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray, contiguous
from stereocal.rig.geometry import Pose, triangulate_rays

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
NO_WORSE_PX = 0.05
"""Smaller differences between residuals are ignored."""


@dataclass(frozen=True, eq=False)
class EpipolarLabels:
    """Residuals and lengths of f frames under both labellings.

    Columns of the arrays (f, 2): original labels, and labels exchanged in the secondary.
    """

    residual_px: FloatArray
    """Sampson distance, root mean square over both targets."""
    length: FloatArray
    """Length of the bar per baseline; NaN where a target is behind a camera."""
    unique: bool
    """No other labels fit nearly as well."""


def compare_labels(
    primary: FloatArray,
    secondary: FloatArray,
    focal_px: float | FloatArray,
    rng: np.random.Generator,
) -> EpipolarLabels | None:
    """Compare both labellings of each frame.

    Args:
        primary, secondary: (f, 2, 2): normalised points by frame, target, (x, y).
        focal_px: converts residuals to pixels; one number, or (f,).

    Returns None if there are too few frames or they determine no geometry.
    """
    frames = len(primary)
    if frames < MINIMUM_FRAMES:
        return None
    rays = np.stack([np.concatenate([primary, s], axis=2) for s in (secondary, secondary[:, ::-1])])
    poses = []
    for E in _samples(rays, rng):
        pose = _refined(E, rays)
        if pose is not None:
            residual = focal_px * _distances(pose.essential, rays)
            poses.append((float(np.median(residual.min(axis=0))), pose, residual))
    if not poses:
        return None
    poses.sort(key=lambda found: found[0])
    least, pose, residual = poses[0]
    swapped = residual[1] < residual[0]
    unique = True
    for other, _, its in poses[1:]:
        differs = (its[1] < its[0]) != swapped
        # Frames where both labellings fit may differ: the bar lies along an epipolar line.
        clear = residual.max(axis=0) > RUNNER_UP * least + NO_WORSE_PX
        if (differs & clear).any() and other < RUNNER_UP * least + NO_WORSE_PX:
            unique = False
    ends = [triangulate_rays(pose.R, pose.T, way.reshape(-1, 4).T.copy()) for way in rays]
    lengths = [np.linalg.norm(points[::2] - points[1::2], axis=1) for points in ends]
    return EpipolarLabels(residual.T, np.column_stack(lengths), unique)


def frame_focal_px(cameras: Sequence[Camera], rays: Sequence[FloatArray]) -> FloatArray:
    """(f,): pixels per unit of the plane z = 1 around the points (f, 2, 2) of both cameras."""
    found = [
        camera.local_focal_px(own.reshape(-1, 2)).reshape(-1, 2)
        for camera, own in zip(cameras, rays, strict=True)
    ]
    return np.asarray(np.concatenate(found, axis=1).mean(axis=1))


def _samples(rays: FloatArray, rng: np.random.Generator) -> list[FloatArray]:
    """Essential matrices of the samples with the least median residual, best first.

    Args:
        rays: (2, f, 2, 4): labelling, frame, target, x and y of both cameras.
    """
    frames = rays.shape[1]
    scored = rays[:, rng.permutation(frames)[:MAXIMUM_SCORED]]
    found = []
    ways = [np.array(way) for way in itertools.product((0, 1), repeat=SAMPLED_FRAMES)]
    for _ in range(SAMPLES):
        chosen = rng.permutation(frames)[:SAMPLED_FRAMES]
        for way in ways:
            E = linear_essential(contiguous(rays[way, chosen].reshape(-1, 4).T))
            if np.isfinite(E).all():
                found.append((float(np.median(_distances(E, scored).min(axis=0))), E))
    found.sort(key=lambda sample: sample[0])
    return [E for _, E in found[:REFINED]]


def _refined(E: FloatArray, rays: FloatArray) -> Pose | None:
    """The pose fitted to the best-fitting frames and labels; None if undetermined.

    Iterates as in least trimmed squares until the selection no longer changes.
    """
    frames = rays.shape[1]
    most = max(MINIMUM_FRAMES - 1, round(KEPT * frames))
    pose: Pose | None = None
    before: tuple[bytes, bytes] | None = None
    for _ in range(10):
        distance = _distances(E, rays)
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


def _distances(E: FloatArray, rays: FloatArray) -> FloatArray:
    """(2, f): Sampson distances, root mean square over the targets of a frame, normalised units."""
    distances: npt.NDArray[np.float64] = np.sqrt((sampson(E, rays) ** 2).mean(axis=-1))
    return distances


def sampson(E: FloatArray, rays: FloatArray) -> FloatArray:
    """(...,): signed Sampson distances of pairs (..., 4), x and y of both cameras, in their units.

    Hartley and Zisserman (2004), Multiple View Geometry, equation 11.9.
    """
    one = np.ones((*rays.shape[:-1], 1))
    p = np.concatenate([rays[..., :2], one], axis=-1)
    q = np.concatenate([rays[..., 2:], one], axis=-1)
    lines, back = p @ E.T, q @ E
    squared = (lines[..., :2] ** 2).sum(axis=-1) + (back[..., :2] ** 2).sum(axis=-1)
    distances: npt.NDArray[np.float64] = (q * lines).sum(axis=-1) / np.sqrt(squared)
    return distances
