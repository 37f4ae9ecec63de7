"""Photographs paired in order, of which one has no partner: from it on, all pairs are wrong.

With the right pairs the targets of all frames lie on the epipolar lines of one pose. Before a slip
these are the pairs as they are, after it those shifted by one: the larger part gives the pose,
which then tells where the slip is.
"""

from collections.abc import Sequence

import numpy as np

from stereocal.fit.screening.outliers import outlying
from stereocal.frames.epipolar_labels import (
    MINIMUM_FRAMES,
    SMALLEST_EXCESS_PX,
    both_ways,
    distances,
    fitting_poses,
    frame_focal_px,
)
from stereocal.frames.frame import Frame
from stereocal.frames.pairing import Alone
from stereocal.rig.camera import Camera
from stereocal.system.array_types import FloatArray

LEAST_AFTER = 3
"""Frames that must fit after the slip, and as many that must not fit as they are."""
LEAST_SHARE = 0.8
"""The share of the frames with targets that must fit with the slip mended."""
MOST_PX = 20.0
"""A frame farther from its epipolar lines is wrong, however wrong."""


def find_slip(frames: Sequence[Frame], cameras: tuple[Camera, Camera]) -> Alone | None:
    """The photograph that has no partner, if leaving it out makes the frames fit.

    Args:
        frames: in the order of the photographs.
    """
    doubted = sum(f.state != "found" and len(f.targets_in_both) == 2 for f in frames)
    if doubted < LEAST_AFTER or len(frames) < 2 * MINIMUM_FRAMES:
        return None
    rays = [_rays(frames, which, camera) for which, camera in enumerate(cameras)]
    rng, half = np.random.default_rng(0), len(frames) // 2
    best: tuple[float, Alone | None] = (np.inf, None)
    for part, by in ((slice(0, half), 0), (slice(half, None), 1), (slice(half, None), -1)):
        first, second = _shifted(rays, by)
        sound = np.isfinite(first[part]).all(axis=(1, 2)) & np.isfinite(second[part]).all(
            axis=(1, 2)
        )
        if sound.sum() < MINIMUM_FRAMES:
            continue
        for pose in fitting_poses(both_ways(first[part][sound], second[part][sound]), rng):
            # (3, n): as they are, the secondary one later, the primary one later.
            apart = np.stack(
                [_apart(pose.essential, *_shifted(rays, k), cameras) for k in (0, 1, -1)]
            )
            best = min(best, _judged(frames, apart), key=lambda judged: judged[0])
    return best[1]


def _judged(frames: Sequence[Frame], apart: FloatArray) -> tuple[float, Alone | None]:
    """The cost and the slip, None if the frames fit best as they are.

    Args:
        apart: (3, n) px, of the frames as they are and shifted; NaN without targets.
    """
    cost = np.where(np.isnan(apart), 0.0, np.minimum(apart, MOST_PX))
    before = np.concatenate([[0.0], np.cumsum(cost[0])])
    best: tuple[float, Alone | None] = (float(before[-1]), None)
    for row in (1, 2):
        after = np.concatenate([np.cumsum(cost[row][::-1])[::-1], [0.0]])
        place = int(np.argmin(before + after))
        total = float((before + after)[place])
        if total >= best[0]:
            continue
        mended = np.concatenate([apart[0, :place], apart[row, place:]])
        known = np.isfinite(mended)
        fits = known.copy()
        fits[known] = ~outlying(mended[known], SMALLEST_EXCESS_PX)
        changed = np.arange(len(mended)) >= place
        limit = float(mended[fits].max(initial=0.0)) + SMALLEST_EXCESS_PX
        wrong = int(((apart[0] > 2 * limit) & changed & fits).sum())
        enough = fits.sum() >= LEAST_SHARE * known.sum() and wrong >= LEAST_AFTER
        why = (
            "without it, and with the later photographs paired one further, the targets of "
            f"{fits.sum()} frames lie on their epipolar lines."
        )
        camera = int(row == 1)
        slip = Alone(frames[place].files[camera], camera, where=why)
        best = total, slip if enough else None
    return best


def _rays(frames: Sequence[Frame], which: int, camera: Camera) -> FloatArray:
    """(n, 2, 2): normalised points of a camera by frame and target; NaN if not both are seen."""
    pixels = np.full((len(frames), 2, 2), np.nan)
    for ends, frame in zip(pixels, frames, strict=True):
        a, b = frame.centres[which]
        if a and b:
            ends[:] = (a.u, a.v), (b.u, b.v)
    return camera.undistort(pixels.reshape(-1, 2)).reshape(-1, 2, 2)


def _shifted(rays: Sequence[FloatArray], by: int) -> tuple[FloatArray, FloatArray]:
    """The points of both cameras, those of the secondary (1) or of the primary (-1) one later."""
    first, second = rays
    later = np.full_like(first, np.nan)
    if by == 0:
        return first, second
    later[:-1] = (second if by > 0 else first)[1:]
    return (first, later) if by > 0 else (later, second)


def _apart(
    E: FloatArray, first: FloatArray, second: FloatArray, cameras: tuple[Camera, Camera]
) -> FloatArray:
    """(n,) px: distance of frames from their epipolar lines in the better labelling."""
    apart = np.full(len(first), np.nan)
    both = np.isfinite(first).all(axis=(1, 2)) & np.isfinite(second).all(axis=(1, 2))
    if both.any():
        rays = first[both], second[both]
        focal = frame_focal_px(cameras, rays)
        apart[both] = focal * distances(E, both_ways(*rays)).min(axis=0)
    return apart
