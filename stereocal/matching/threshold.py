"""Choose a matching threshold from the points themselves: `--threshold auto`.

Let a frame have `n` correct pairs whose error e has density f and distribution F. Wrong partners
lie at any distance from the epipolar line, so near e = 0 the density of wrong pairs is uniform: `s`
per pixel. With a threshold t

    lost(t)  = n (1 - F(t))                     correct pairs beyond the threshold,
    wrong(t) = s * integral_0^t u(e) v(e) de    wrong pairs that are taken,
    u(e) = 1 - n F(e) / n_primary,  v(e) = 1 - n F(e) / n_secondary.

u and v are the fractions of points without their partner within e: since the assignment is
one-to-one, a wrong pair is taken only if both its points lack their own partner (missing, spurious
or lost). Without these factors half of the pairs of a dense flock would be lost. Pairs that
exchange partners are not counted: their number hardly depends on the threshold. The chosen
threshold minimises lost + wrong.

n, s and f are estimated from the errors of all pairs of a sample of frames, up to an error with
about four pairs per point: a mixture of a peak (correct pairs) and a uniform (wrong pairs), fitted
by maximum likelihood. The peak is half-normal, with a tail of 5 % of the pairs at three times the
scale, as real detections have.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.special import erf

from stereocal.errors import StereocalError
from stereocal.matching.matching import ANY_DEPTH, check_depths
from stereocal.matching.pair_candidates import pairs_within
from stereocal.rig.compiled import FloatArray
from stereocal.rig.parameters import RigParameters
from stereocal.system.numbers import rounded

SAMPLE_FRAMES = 20
SAMPLE_POINTS = 2000
"""A sample has at least this many frames, and more until it has this many points."""
PAIRS_PER_POINT = 4
"""Enough wrong pairs to estimate their density, and close enough to 0 for it to be uniform."""
BINS = 400
TAIL = 0.05
TAIL_SCALE = 3.0
EVIDENCE = 30.0
"""Required value of twice the gain in log likelihood by the peak; chance gives 10 at most."""
MAXIMUM_LOST = 0.5
"""A threshold that loses a larger fraction of the correct pairs is rejected."""
CLEAR = 0.05
"""The distributions are apart if at most this fraction of the pairs is lost, and of them wrong."""
MINIMUM_UNPARTNERED = 0.01
"""Lower limit of the fraction of points without a partner."""

FramePixels = tuple[FloatArray, FloatArray]
"""Raw pixels (n, 2) of the primary and (m, 2) of the secondary in one frame."""


@dataclass(frozen=True)
class ThresholdChoice:
    """A threshold, and the estimates behind it."""

    threshold_px: float
    sigma_px: float
    """Scale of the half-normal of correct pairs, without the tail."""
    wrong_per_point: float
    """Expected wrong candidates of a primary point within the threshold."""
    partnered: float
    """Estimated fraction of primary points whose partner is among the secondary's points."""
    lost: float
    """Expected fraction of correct pairs beyond the threshold."""
    wrong: float
    """Expected fraction of wrong pairs among those taken."""

    @property
    def apart(self) -> bool:
        """Whether a threshold lies between the distributions of correct and of wrong pairs."""
        return max(self.lost, self.wrong) <= CLEAR

    def sentence(self) -> str:
        return (
            f"Threshold chosen from the points: {rounded(self.threshold_px, 3)} px. Correct "
            "pairs have "
            f"errors of about {rounded(self.sigma_px)} px; a point has "
            f"{rounded(self.wrong_per_point)} wrong "
            f"candidates within the threshold on average; about {100 * self.lost:.1f} % of the "
            "correct pairs lie beyond it."
        )


def sample_of(frames: Sequence[int], points_per_frame: float) -> set[int]:
    """Evenly spaced frames to choose a threshold from."""
    wanted = max(SAMPLE_FRAMES, int(np.ceil(SAMPLE_POINTS / max(points_per_frame, 1e-9))))
    at = np.linspace(0, len(frames) - 1, min(wanted, len(frames))).round().astype(int)
    return {int(frames[k]) for k in at}


def choose_threshold(
    rig: RigParameters,
    frames: Sequence[FramePixels],
    depths_m: tuple[float, float] = ANY_DEPTH,
) -> ThresholdChoice:
    """The threshold that minimises lost plus wrong pairs (see the module).

    Args:
        frames: 20 frames are enough if they have many points; see `sample_of`.

    Raises:
        StereocalError: no pairs at all, or correct and wrong pairs cannot be separated.
    """
    pooled, limit = _pooled_errors(rig, frames, depths_m)
    if not len(pooled):
        raise StereocalError(
            "No threshold can be chosen: no pair of points meets in front of both cameras."
        )
    edges = np.concatenate([[0.0], np.geomspace(1e-4 * limit, limit, BINS)])
    counts, _ = np.histogram(pooled, edges)
    sigma, share, gain = _fit(counts.astype(np.float64), edges)
    points = np.array([[len(p), len(s)] for p, s in frames], dtype=np.float64).sum(axis=0)
    wrong_per_px = (1 - share) * len(pooled) / limit
    chosen = _choose(sigma, share * len(pooled), wrong_per_px, points, limit)
    if gain < EVIDENCE or chosen.lost > MAXIMUM_LOST:
        raise StereocalError(
            "No threshold can be chosen: correct and wrong pairs cannot be separated, because the "
            "points are too dense for this parameter set, or it does not fit them. Match with the "
            "2D set, narrow the depth range, or state a threshold in pixels."
        )
    return chosen


def _pooled_errors(
    rig: RigParameters, frames: Sequence[FramePixels], depths_m: tuple[float, float]
) -> tuple[FloatArray, float]:
    """The errors of all pairs of all frames up to a limit, and the limit."""
    near, far = check_depths(depths_m)
    scale = np.array([rig.primary.pixel_scale, rig.secondary.pixel_scale])
    found, wanted = [np.empty(0)], 0
    for primary, secondary in frames:
        first, second = rig.primary.undistort(primary), rig.secondary.undistort(secondary)
        _, _, errors, _, _ = pairs_within(
            rig.pose.R, rig.pose.T, first, second, scale, np.inf, near, far
        )
        few = min(len(primary), len(secondary))
        wanted += max(few, min(PAIRS_PER_POINT * few, 3 * len(primary) * len(secondary) // 4))
        # Enough for frames of different density, and still far fewer than all.
        most = 10 * PAIRS_PER_POINT * few
        found.append(errors if len(errors) <= most else np.partition(errors, most)[:most])
    pooled = np.sort(np.concatenate(found))[:wanted]
    return pooled, float(pooled[-1]) if len(pooled) else 0.0


def _fit(counts: FloatArray, edges: FloatArray) -> tuple[float, float, float]:
    """Scale of the half-normal, its fraction, and twice the log likelihood gain over no peak."""
    limit = edges[-1]
    scales = np.geomspace(3e-4 * limit, 0.5 * limit, 150)[:, None]
    peak = np.diff(_found(edges, scales), axis=1) / _found(limit, scales)
    flat = np.diff(edges) / limit
    share = np.full((len(scales), 1), 0.1)
    total = counts.sum()
    for _ in range(200):
        mixed = share * peak + (1 - share) * flat
        share = (counts * share * peak / mixed).sum(axis=1, keepdims=True) / total
    likelihood = (counts * np.log(share * peak + (1 - share) * flat)).sum(axis=1)
    best = int(np.argmax(likelihood))
    gain = 2 * (likelihood[best] - (counts * np.log(flat)).sum())
    return float(scales[best, 0]), float(share[best, 0]), float(gain)


def _found(error: npt.ArrayLike, scale: npt.ArrayLike) -> FloatArray:
    """F: the fraction of correct pairs up to an error."""
    relative = np.asarray(error) / (np.sqrt(2.0) * np.asarray(scale))
    share: FloatArray = (1 - TAIL) * erf(relative) + TAIL * erf(relative / TAIL_SCALE)
    return share


def _choose(
    sigma: float, correct: float, wrong_per_px: float, points: FloatArray, limit: float
) -> ThresholdChoice:
    """Minimise lost + wrong over all frames together."""
    partnered = np.minimum(correct / points, 1 - MINIMUM_UNPARTNERED)
    errors = np.concatenate([[0.0], np.geomspace(1e-2 * sigma, limit, 4000)])
    found = _found(errors, sigma)
    free = (1 - partnered[0] * found) * (1 - partnered[1] * found)
    taken = np.concatenate([[0.0], np.cumsum(0.5 * (free[1:] + free[:-1]) * np.diff(errors))])
    at = int(np.argmin(correct * (1 - found) + wrong_per_px * taken))
    wrong = wrong_per_px * taken[at]
    return ThresholdChoice(
        threshold_px=float(errors[at]),
        sigma_px=sigma,
        wrong_per_point=float(wrong_per_px * errors[at] / points[0]),
        partnered=float(partnered[0]),
        lost=float(1 - found[at]),
        wrong=float(wrong / max(wrong + correct * found[at], 1e-300)),
    )
