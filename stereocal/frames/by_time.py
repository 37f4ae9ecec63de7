"""Which photographs of two cameras were taken at one moment, by clocks that differ by a constant.

A pair costs r^2 / (2 s^2), with r its distance from the difference of the clocks and s their
scatter; a photograph without a partner costs `ALONE`. Every difference of two times is a candidate
for the difference of the clocks. Where photographs were taken at equal intervals, a shift by one
costs as little: then the times alone do not tell, and `Alignment.sure` is False.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import linear_sum_assignment

from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.taken import Source, Taken

ALONE = 5.0
"""-log of the probability, 0.7 %, that a photograph has no partner."""
REACH = 2 * np.sqrt(ALONE)
"""In scatters: farther apart, two photographs without partners cost less than a pair."""
TRIGGER_S, LEAST_SCATTER_S = 0.4, 0.02
"""Scatter of two shutters released by hand, the first guess, and the smallest that is believed."""
TOGETHER = 8.0
"""What clocks that agree save: those of two cameras that were set by nobody rarely do."""
CANDIDATES = 40
LEAST_PAIRS, LEAST_SHARE = 3, 0.7
"""Fewer pairs, or a smaller share of the camera with fewer photographs, may be chance."""
MARGIN = 8.0
"""How much more the next best difference of the clocks must cost."""
MOST_EXACT = 200
"""Photographs that follow each other closer than can be told apart are solved together, up to this
number; above it each takes its nearest."""

LEAST_PAUSE_S = 2.0
"""Files that were written faster than this tell when they were copied."""


@dataclass(frozen=True, eq=False)
class Times:
    """The times of one camera."""

    names: list[str]
    """Photographs with a time, in order."""
    seconds: FloatArray
    step: float
    source: Source
    zones: list[float | None]


@dataclass(frozen=True, eq=False)
class Alignment:
    """The photographs of two cameras that fit by time."""

    pairs: IntArray
    """(k, 2): rows of the two cameras, in order of time."""
    clocks_s: float
    """How much the clock of the second camera is ahead."""
    cost: float
    sure: bool = False
    """Whether every other difference of the clocks fits clearly worse."""


def times_of(names: Sequence[str], taken: Mapping[str, Taken]) -> Times:
    """The times of a camera, by the source that most of its photographs have."""
    sources = [taken[name].source for name in names if taken[name].seconds is not None]
    source: Source = max(sources, key=sources.count, default="")
    timed = {name: taken[name] for name in names if source and taken[name].source == source}
    seconds = np.array([one.seconds for one in timed.values()], np.float64)
    step = max((one.step for one in timed.values()), default=1.0)
    return Times([*timed], seconds, step, source, [one.zone for one in timed.values()])


def aligned_clocks(first: Times, second: Times) -> Alignment | None:
    """The photographs of two cameras that fit by time; None if their times cannot tell."""
    times = first, second
    zones = [zone for camera in times for zone in camera.zones]
    clocks = []
    for camera in times:
        if camera.source == "file" and _pause(camera.seconds) < LEAST_PAUSE_S:
            return None
        ahead = np.zeros(len(camera.names))
        if None not in camera.zones and camera.zones:
            # Of one camera only, no more than what its zone has changed.
            start = camera.zones[0] if None in zones else 0.0
            ahead = np.array(camera.zones, np.float64) - (start or 0.0)
        clocks.append(camera.seconds - ahead)
    return align(clocks[0], clocks[1], (times[0].step, times[1].step))


def _pause(seconds: FloatArray) -> float:
    return float(np.median(np.diff(np.sort(seconds)))) if len(seconds) > 1 else 0.0


def align(first: FloatArray, second: FloatArray, steps: tuple[float, float]) -> Alignment | None:
    """Pair two cameras by time: the difference of the clocks of least cost, as said above.

    Args:
        first, second: (n,) and (m,), in s; equal times are in the order of the photographs.
        steps: resolutions of the two clocks, s.

    Returns:
        The cheapest alignment; None if there is none of `LEAST_PAIRS`.
    """
    smaller = min(len(first), len(second))
    if smaller < LEAST_PAIRS:
        return None
    # A time told to a step is uniform over it, with a standard deviation of step / sqrt(12).
    least = float(np.hypot(LEAST_SCATTER_S, np.hypot(*steps) / np.sqrt(12)))
    scatter = float(np.hypot(TRIGGER_S, least))
    clocks = _candidates(first, second, REACH * scatter)
    tried = [_try(first, second, clock, scatter) for clock in clocks]
    for _ in range(2):  # the scatter is that of the best; then all are judged by it
        best = min(tried, key=lambda one: one.cost)
        if len(best.pairs) < LEAST_PAIRS:
            return None
        apart = second[best.pairs[:, 1]] - first[best.pairs[:, 0]] - best.clocks_s
        scatter = min(scatter, max(least, float(np.sqrt(np.mean(apart**2)))))
        tried = [_try(first, second, alignment.clocks_s, scatter) for alignment in tried]
    best = min(tried, key=lambda one: one.cost)
    if len(best.pairs) < LEAST_PAIRS:
        return None
    taken = {*map(tuple, best.pairs.tolist())}
    others = [one.cost for one in tried if not taken & {*map(tuple, one.pairs.tolist())}]
    enough = len(best.pairs) >= LEAST_SHARE * smaller
    alone = min(others, default=np.inf) - best.cost >= MARGIN
    return replace(best, sure=enough and alone)


def _candidates(first: FloatArray, second: FloatArray, reach: float) -> list[float]:
    """Differences of the clocks that many pairs have, within `reach` on either side."""
    differences = np.sort((second[None, :] - first[:, None]).ravel())
    low = np.searchsorted(differences, differences - reach)
    counts = np.searchsorted(differences, differences + reach, side="right") - low
    clocks = list[float]()
    for k in np.argsort(-counts, kind="stable"):
        if all(abs(differences[k] - clock) > reach / 2 for clock in clocks):
            clocks.append(float(differences[k]))
            if len(clocks) == CANDIDATES:
                break
    return clocks


def _try(first: FloatArray, second: FloatArray, clocks: float, scatter: float) -> Alignment:
    """The pairs at about a difference of the clocks, which they correct."""
    pairs = np.empty((0, 2), np.int64)
    for _ in range(3):
        pairs = _pairs(first + clocks, second, scatter)
        if not len(pairs):
            break
        clocks = float(np.median(second[pairs[:, 1]] - first[pairs[:, 0]]))
    apart = (second[pairs[:, 1]] - first[pairs[:, 0]] - clocks) / scatter
    alone = len(first) + len(second) - 2 * len(pairs)
    together = TOGETHER * (abs(clocks) <= REACH * scatter)
    return Alignment(pairs, clocks, float(0.5 * apart @ apart) + ALONE * alone - together)


def _pairs(first: FloatArray, second: FloatArray, scatter: float) -> IntArray:
    """The cheapest pairs of times by one clock, solved between pauses longer than the reach."""
    times = np.concatenate([first, second])
    order = np.argsort(times, kind="stable")
    starts = np.flatnonzero(np.diff(times[order], prepend=-np.inf) > REACH * scatter)
    ends = np.append(starts[1:], len(order))
    of_first = np.add.reduceat(order < len(first), starts, dtype=np.int64)
    shared = (of_first > 0) & (of_first < ends - starts)
    pairs = []
    for start, end in zip(starts[shared], ends[shared], strict=True):
        group = order[start:end]
        rows, columns = group[group < len(first)], group[group >= len(first)] - len(first)
        apart = (second[columns][None, :] - first[rows][:, None]) / scatter
        pairs.append(_solve(apart, rows, columns))
    return np.concatenate(pairs) if pairs else np.empty((0, 2), np.int64)


def _solve(apart: FloatArray, rows: IntArray, columns: IntArray) -> IntArray:
    cost = np.minimum(0.5 * apart**2, 2 * ALONE)
    if max(cost.shape) <= MOST_EXACT:
        i, j = linear_sum_assignment(cost)
    else:
        j = np.argmin(cost, axis=1)
        i = np.flatnonzero(np.argmin(cost, axis=0)[j] == np.arange(len(rows)))
        j = j[i]
    near = cost[i, j] < 2 * ALONE
    # Sorted, because equal times are in the order of the photographs; it costs no more.
    return np.column_stack([rows[i[near]], columns[np.sort(j[near])]])
