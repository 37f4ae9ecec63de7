"""Photographs paired in order, of which some have no partner: from the first on, all pairs are
wrong.

With the right pairs the targets of all frames lie on the epipolar lines of one pose. Runs of
neighbouring photographs, paired as they are or some photographs further, give poses; of each, the
photographs to leave out are those of the alignment of both sequences that costs least (Needleman
and Wunsch, 1970, J. Mol. Biol. 48, 443). A pair costs its distance from the epipolar lines, at most
1, which is that of a wrong pair; a photograph without a partner costs `ALONE`.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from stereocal.fit.screening.outliers import outlying
from stereocal.frames.epipolar_labels import (
    MINIMUM_FRAMES,
    NO_POSE_PX,
    SMALLEST_EXCESS_PX,
    both_ways,
    distances,
    fitting_poses,
    frame_focal_px,
    refined_pose,
)
from stereocal.frames.frame import Frame
from stereocal.frames.pairing import short_names
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.geometry import Pose
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import count
from stereocal.verdict.in_words import listed

LEAST_WRONG = 3
"""Frames that must not fit as they are, for one photograph without a partner."""
ALONE = LEAST_WRONG - 0.5
"""The cost of a photograph without a partner, in wrong pairs."""
SURE = 0.3
"""The least by which it must cost more to decide otherwise on any photograph, in wrong pairs."""
FARTHEST = 3
"""Photographs by which the partners may be apart in the order."""
RUNS = 6
"""Runs of neighbouring photographs, which overlap by half, are this part of all of them."""
SAMPLES, REFINED = 16, 4
"""Samples of a run, and the best of them that are refined."""
LEAST_SHARE = 0.8
"""The share of the frames with targets that must fit without the photographs left out."""
MOST_PX = 20.0
"""A frame farther from its epipolar lines is wrong, until it is known how well the others fit."""


@dataclass(frozen=True)
class Slips:
    """Photographs without a partner."""

    names: tuple[tuple[str, ...], tuple[str, ...]]
    """Those of the primary and of the secondary camera."""
    fitting: int
    """Frames that fit without them."""

    @property
    def all(self) -> tuple[str, ...]:
        return (*self.names[0], *self.names[1])

    @property
    def it(self) -> str:
        """The word for the photographs: it or them."""
        return "it" if len(self.all) == 1 else "them"

    def __str__(self) -> str:
        lacking = "; ".join(
            f"the {CAMERAS[1 - camera]} camera has no photograph for {listed(short_names(names))}"
            for camera, names in enumerate(self.names)
            if names
        )
        return (
            f"T{lacking[1:]}. Without {self.it}, and with the others paired in order, the targets "
            f"of {count(self.fitting, 'frame')} lie on their epipolar lines."
        )


def find_slips(frames: Sequence[Frame], cameras: tuple[Camera, Camera]) -> Slips | None:
    """The photographs that have no partner, if it is sure which, and the other frames then fit.

    Args:
        frames: in the order of the photographs.
    """
    doubted = sum(f.state != "found" and len(f.targets_in_both) == 2 for f in frames)
    if doubted < LEAST_WRONG or len(frames) < 2 * MINIMUM_FRAMES:
        return None
    pairs = _pairs(frames, cameras)
    for pose in pairs.poses():
        if (mended := pairs.mended(pose)) is not None:
            alone, fitting = mended
            first, second = (tuple(frames[k].files[c] for k in alone[c]) for c in (0, 1))
            return Slips((first, second), fitting) if first or second else None
    return None


def _rays(frames: Sequence[Frame], which: int, camera: Camera) -> FloatArray:
    """(n, 2, 2): normalised points of a camera by frame and target; NaN if not both are seen."""
    pixels = np.full((len(frames), 2, 2), np.nan)
    for ends, frame in zip(pixels, frames, strict=True):
        a, b = frame.centres[which]
        if a and b:
            ends[:] = (a.u, a.v), (b.u, b.v)
    return camera.undistort(pixels.reshape(-1, 2)).reshape(-1, 2, 2)


def _pairs(frames: Sequence[Frame], cameras: tuple[Camera, Camera]) -> "_Pairs":
    """All pairs of photographs in which both cameras see both targets."""
    rays = [_rays(frames, which, camera) for which, camera in enumerate(cameras)]
    i, j = np.indices((len(frames), len(frames))).reshape(2, -1)
    first, second = (np.asarray(np.isfinite(points).all(axis=(1, 2))) for points in rays)
    near = (np.abs(j - i) <= FARTHEST) & first[i] & second[j]
    seen = np.stack([i[near], j[near]])
    paired = rays[0][seen[0]], rays[1][seen[1]]
    return _Pairs(len(frames), seen, both_ways(*paired), frame_focal_px(cameras, paired))


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Pairs of photographs at most `FARTHEST` apart in the order."""

    photographs: int
    """Of each camera."""
    seen: IntArray
    """(2, m): the places of both photographs in the order."""
    ways: FloatArray
    """(2, m, 2, 4): as `both_ways`."""
    focal_px: FloatArray
    """(m,): as `frame_focal_px`."""

    def poses(self) -> Iterator[Pose]:
        """Poses that fit runs of neighbouring pairs, those paired as they are first."""
        length, rng = max(MINIMUM_FRAMES, self.photographs // RUNS), np.random.default_rng(0)
        for by in sorted(range(-FARTHEST, FARTHEST + 1), key=abs):
            of = np.flatnonzero(self.seen[1] - self.seen[0] == by)
            for start in range(0, len(of) - length // 2, length // 2):
                run = of[max(0, min(start, len(of) - length)) :][:length]
                if len(run) >= MINIMUM_FRAMES:
                    yield from fitting_poses(self.ways[:, run], rng, SAMPLES, REFINED)

    def mended(self, pose: Pose) -> tuple[list[IntArray], int] | None:
        """The photographs of both cameras to leave out by a pose, which is improved on the way, and
        the number of frames that then fit; None if too few do, or if it is not sure."""
        n, (i, j), wrong_px = self.photographs, self.seen, MOST_PX
        for _ in range(3):
            apart_px = self.focal_px * distances(pose.essential, self.ways).min(axis=0)
            cost = np.zeros((2, n, 2 * FARTHEST + 1))
            share = np.minimum(apart_px / wrong_px, 1.0)
            cost[0, i, FARTHEST + j - i] = cost[1, j, FARTHEST + i - j] = share
            gains = np.stack([_gains(of_camera) for of_camera in cost])
            first, second = (np.flatnonzero(gain <= 0.0) for gain in gains)
            partner, some = np.full(n, -1), min(len(first), len(second))
            partner[first[:some]] = second[:some]
            paired = partner[i] == j
            fits = paired & (apart_px < wrong_px)
            fits[paired] &= ~outlying(apart_px[paired], SMALLEST_EXCESS_PX)
            if fits.sum() < max(MINIMUM_FRAMES, LEAST_SHARE * paired.sum()):
                return None
            wrong_px = 2.0 * (float(apart_px[fits].max()) + SMALLEST_EXCESS_PX)
            pose = refined_pose(pose.essential, self.ways[:, fits]) or pose
        if wrong_px > NO_POSE_PX or np.abs(gains).min() < SURE:
            return None
        return [np.flatnonzero(gain > 0.0) for gain in gains], int(fits.sum())


def _gains(cost: FloatArray) -> FloatArray:
    """(n,): how much less it costs to leave a photograph of one camera out than to pair it.

    Args:
        cost: (n, 2k + 1), of its pairs with the photographs of the other camera from k before to k
            after it in the order.
    """
    n, width = cost.shape
    steps = ALONE * np.arange(width)
    # By the photographs of this camera that are past, and how much further the other is.
    before = np.full((n, width), np.inf)
    state = np.where(np.arange(width) < width // 2, np.inf, steps - steps[width // 2])
    for k in range(n):
        before[k] = state
        left_out = np.append(state[1:] + ALONE, np.inf)
        state = np.minimum(state + cost[k], left_out)
        state = np.minimum.accumulate(state - steps) + steps
    after, gains = np.zeros(width), np.empty(n)
    for k in reversed(range(n)):
        paired, left_out = cost[k] + after, ALONE + np.append(np.inf, after[:-1])
        gains[k] = (before[k] + paired).min() - (before[k] + left_out).min()
        after = np.minimum(paired, left_out) + steps
        after = np.minimum.accumulate(after[::-1])[::-1] - steps
    return gains
