"""Since when has a camera moved? The change point in many frames.

Before the change point a frame has the old parameters, a step L p from the file's, from it on also
the change d. Each frame's cost is quadratic near the file's and near the moved pose, so that p and
d follow for every change point from sums of normal equations. Its posterior, with all frames
equally likely beforehand, gives the interval.
"""

from dataclasses import dataclass

import numpy as np

from stereocal.field.checking.fits import NOTHING, Change, Fit
from stereocal.field.checking.new_images import NewImages
from stereocal.field.checking.prior import Prior
from stereocal.system.array_types import BoolArray, FloatArray, IntArray

ROUNDS = 3
INSIDE = 0.95


@dataclass(frozen=True)
class Since:
    """The first frame after the movement, and the 95 % interval of its number."""

    frame: int
    low: int
    high: int
    gain: float
    """Cost difference to no movement at all."""
    candidates: int
    """Frames that may have been the first; a test of the best is corrected for their number."""
    at: int
    """Index of the first group after the latest change point of the interval."""
    lasts: bool
    """Whether both halves of what follows fit better with the movement than without it."""


def since_when(prior: Prior, images: NewImages, moved: Fit, outlying: BoolArray) -> Since:
    """The change point; `moved` is a fit of all groups with the pose free, and `outlying` (f,) are
    groups that contradict their neighbours.
    """
    change, sigma_px, numbers = moved.change, moved.sigma_px, images.numbers
    same = _equations(Fit(prior, images, NOTHING, sigma_px), outlying)
    starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
    first, index = -1, np.arange(len(numbers))
    for _ in range(ROUNDS):
        costs = _costs(prior, change, same, _equations(moved, outlying), starts)
        start = int(starts[np.argmin(costs)])
        if start == first:
            break
        first = start
        moved = Fit(prior, images, change, sigma_px).minimise(outlying | (index < first))
    without = same.between(first, prior.root @ moved.p[: moved.known])
    with_it = _equations(moved, outlying).between(first, moved.q - prior.at.q)
    best = int(np.argmin(costs))
    weights = np.exp(-0.5 * (costs - costs[best]))
    order = np.argsort(-weights)
    shares = np.cumsum(weights[order]) / weights.sum()
    inside = order[: int(np.searchsorted(shares, INSIDE)) + 1]
    low, high = int(inside.min()), int(inside.max())
    root = prior.root
    A, b = root.T @ same.H[0] @ root + np.eye(root.shape[1]), root.T @ same.g[0]
    cost_of_none = float(same.c[0] - b @ np.linalg.solve(A, b))
    return Since(
        frame=int(numbers[starts[best]]),
        low=int(numbers[starts[low]]),
        high=int(numbers[starts[high]]),
        gain=float(cost_of_none - costs[best]),
        candidates=len(starts),
        at=int(starts[high]),
        lasts=bool((without > with_it).all()),
    )


@dataclass(frozen=True, eq=False)
class _Equations:
    """Quadratic costs c + 2 g x + x H x of groups, x being the step from the prior.

    Each row, of (f + 1, 33, 33), (f + 1, 33) and (f + 1,), is the sum over the groups from i to the
    last.
    """

    H: FloatArray
    g: FloatArray
    c: FloatArray

    def between(self, first: int, x: FloatArray) -> FloatArray:
        """(2,): the costs at x of the two halves of the groups from the first on."""
        ends = [first, (first + len(self.c)) // 2, len(self.c) - 1]
        costs = self.c[ends] + 2.0 * self.g[ends] @ x + np.einsum("i,fij,j->f", x, self.H[ends], x)
        return np.asarray(-np.diff(costs))


def _equations(fit: Fit, outlying: BoolArray) -> _Equations:
    """The costs of the groups, quadratic about a fit, in sums from each to the last."""
    groups = [np.flatnonzero(~outlying[f : f + 1]) + f for f in range(len(outlying))]
    H, g, c = fit.equations(groups)
    x = fit.q - fit.prior.at.q
    Hx = np.einsum("fij,j->fi", H, x)
    sums = (
        np.cumsum(np.concatenate([terms, np.zeros_like(terms[:1])])[::-1], axis=0)[::-1]
        for terms in (H, g - Hx, c + Hx @ x - 2.0 * g @ x)
    )
    return _Equations(*sums)


def _costs(
    prior: Prior, change: Change, same: _Equations, moved: _Equations, starts: IntArray
) -> FloatArray:
    """(len(starts),): the least cost with the change from each of these groups on."""
    known = prior.root.shape[1]
    both = np.column_stack([prior.root, change.directions])
    precision = np.diag(np.concatenate([np.ones(known), 1.0 / change.sigma**2]))
    costs = np.empty(len(starts))
    for i, start in enumerate(starts):
        A, b = precision + both.T @ moved.H[start] @ both, both.T @ moved.g[start]
        A[:known, :known] += prior.root.T @ (same.H[0] - same.H[start]) @ prior.root
        b[:known] += prior.root.T @ (same.g[0] - same.g[start])
        constant = same.c[0] - same.c[start] + moved.c[start]
        costs[i] = constant - b @ np.linalg.solve(A, b)
    return costs
