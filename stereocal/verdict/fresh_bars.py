"""Bars as they could be recorded next: a smoothed bootstrap of the recorded ones.

Each draw weights the recorded bars at random (Bayesian bootstrap, Rubin 1981), since they show
their population only in part. A bar is moved by a normal kernel in its direction from the primary
camera and the logarithm of its depth, and turned by one that follows how the recorded directions
spread: bars that all point along one axis stay so. The moved bars are shrunk towards their mean, so
that they spread no more than the recorded ones. A bar that would leave one of the two images is
moved less, or not at all, so that those near the edges keep their share.
"""

from __future__ import annotations

import numpy as np

from stereocal.errors import StereocalError
from stereocal.refined.refine import RefinedResult
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray
from stereocal.verdict.judging import photograph

DIMENSIONS = 5
BANDWIDTHS = (1.0, 1.0, 0.5, 0.25, 0.0)
"""Tried in turn, in units of Silverman's for a normal distribution; people's bars fill a volume
rather evenly, and a wide kernel would blur its edges."""
GROUP = 5
"""Frames within which wrong pairs are formed, as in the paper."""
MINIMUM_BARS = 3


def fresh_bars(model: RefinedResult, draws: int, bars: int, rng: np.random.Generator) -> FloatArray:
    """Ends A and B of fresh bars, (draws, bars, 2, 3) in metres in the primary's frame.

    Raises:
        StereocalError: fewer than 3 bars were recorded.
    """
    ends = model.points_m[~model.outlying]
    ends = ends[np.isfinite(ends).all(axis=(1, 2))]
    if len(ends) < MINIMUM_BARS:
        raise StereocalError("A forecast needs at least 3 bars with both targets.")
    middles, along = ends.mean(axis=1), ends[:, 0] - ends[:, 1]
    lengths = np.linalg.norm(along, axis=1)
    places = np.column_stack([middles[:, :2] / middles[:, 2:], np.log(middles[:, 2])])
    directions = along / lengths[:, None]

    drawn = _drawn(len(ends), draws, bars, rng)
    rule = (4 / ((DIMENSIONS + 2) * len(ends))) ** (1 / (DIMENSIONS + 4))
    centre, spread = places.mean(axis=0), np.cov(places.T)
    axes = directions.T @ directions / len(ends)
    fresh = ends[drawn]
    missing = np.ones(drawn.shape, dtype=np.bool_)
    for factor in BANDWIDTHS:
        own, h = drawn[missing], factor * rule
        kernel = rng.multivariate_normal(np.zeros(3), spread, len(own), method="eigh")
        turn = rng.multivariate_normal(np.zeros(3), axes, len(own), method="eigh")
        moved = places[own] + h * kernel
        moved[:, 2] = centre[2] + (moved[:, 2] - centre[2]) / np.hypot(1.0, h)
        turned = directions[own] + h * turn
        turned *= 0.5 * (lengths[own] / np.linalg.norm(turned, axis=1))[:, None]
        depth = np.exp(moved[:, 2:])
        middle = np.hstack([moved[:, :2] * depth, depth])
        fresh[missing] = np.stack([middle + turned, middle - turned], axis=1)
        missing[missing] = ~_seen(model, fresh[missing])
        if not missing.any():
            break
    return fresh


def _drawn(recorded: int, draws: int, bars: int, rng: np.random.Generator) -> IntArray:
    """(draws, bars): indices of recorded bars, each draw with its own weights.

    Within `GROUP` bars in turn none is drawn twice (Gumbel's maxima): two copies of a bar would be
    closer together than any two that were recorded, and wrong pairs of them look right.
    """
    weights = np.log(np.maximum(rng.dirichlet(np.ones(recorded), draws), 1e-300))
    groups = -(-bars // GROUP)
    keys = weights[:, None] + rng.gumbel(size=(draws, groups, recorded))
    size = min(GROUP, recorded)
    drawn = np.argpartition(-keys, size - 1, axis=-1)[..., :size]
    return np.asarray(drawn.reshape(draws, -1)[:, np.arange(bars) % (groups * size)])


def _seen(model: RefinedResult, bars: FloatArray) -> BoolArray:
    """(n,): whether both cameras see both ends of bars (n, 2, 3)."""
    points = np.ascontiguousarray(bars.reshape(-1, 3))
    pixels = np.empty((len(points), 4))
    photograph(model.q, model.lenses, points, pixels)
    sizes = np.array([*model.primary.image_size, *model.secondary.image_size]) - 0.5
    seen = ((pixels > -0.5) & (pixels < sizes)).all(axis=1) & (points[:, 2] > 0)
    seen &= model.pose.apply(points)[:, 2] > 0
    return np.asarray(seen.reshape(-1, 2).all(axis=1))
