"""Value and 95 % interval of a figure from its draws.

The interval is that of the figure of the population: the scatter of the finite number of bars in a
draw is estimated from the difference of its two halves, and removed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stereocal.evaluation.counting import CORRECT
from stereocal.evaluation.summary import Estimate, merge_bins, overlap
from stereocal.system.array_types import FloatArray, IntArray

MERGE = 5
"""Bins of the counts in a bin of the PDFs of 0.1 decade."""
SHARE_SCATTER = 0.55
"""Part of the difference of two halves that is removed from shares and overlaps. They are sums of
minima or of rare cases, whose halves differ more than half of the whole scatters: of the intervals
of the FCP, 65 to 72 % held with all of it removed, 77 to 94 % with 0.75, 91 to 100 % with 0.5."""
RARELY_NONE = 0.05
"""Share of halves without a case, up to which their difference is used."""
WIDER = 1.15
"""Factor of the intervals of lengths and pixels, in logarithms: 25 bars show less of their
population than draws of them tell. Measured on 669 rigs without it: 86 to 95 % held."""
FLOOR = 0.04
"""Standard deviation of the logarithm of length errors that no number of frames removes: how people
place their next bars. Without it 80 to 93 % held at 200 frames."""
UNSEEN_TAIL = 16.0
"""Part of the share of correct pairs lost, times the number of bars, that so few do not show of its
tail. Without it, 85 to 92 % held for the 3D set at 25 and 50 frames with wrong lenses."""
LEVEL = 0.95
TAILS = (50 * (1 - LEVEL), 100 - 50 * (1 - LEVEL))


@dataclass(frozen=True)
class Scale:
    """A transformation in which the scatter of a finite sample hardly depends on the value."""

    to: Callable[[Any], Any]
    back: Callable[[Any], Any]
    wider: float = 1.0
    floor: float = 0.0
    """Added to the standard deviation of the draws, in quadrature."""


LOG = Scale(np.log, np.exp, WIDER)
LENGTH = Scale(np.log, np.exp, WIDER, FLOOR)
ROOT = Scale(np.sqrt, np.square)


def interval_of(
    whole: FloatArray, halves: FloatArray, scale: Scale, removed: float = 1.0
) -> Estimate:
    """Median and 95 % interval over draws, without the scatter of the finite number of bars.

    The difference of two halves shows that scatter, of which a part is `removed`; the draws are
    shrunk by its share. `whole` is (draws,), `halves` (draws, 2).
    """
    known = np.isfinite(whole) & np.isfinite(halves).all(axis=1)
    if known.sum() < 2:
        return Estimate(float("nan"), float("nan"), float("nan"))
    with np.errstate(divide="ignore"):
        draws = np.maximum(scale.to(whole[known]), -700.0)
        parts = np.maximum(scale.to(halves[known]), -700.0)
    of_sample = float(np.mean(np.square(parts[:, 0] - parts[:, 1]))) / 4.0
    total = float(draws.var())
    kept = np.sqrt(max(1.0 - removed * of_sample / total, 0.0)) if total > 0 else 0.0
    middle = float(draws.mean())
    kept = float(np.hypot(scale.wider * kept, scale.floor / np.sqrt(total))) if total > 0 else 0.0
    shrunk = middle + kept * (draws - middle)
    value, *ends = (float(scale.back(v)) for v in np.percentile(shrunk, (50, *TAILS)))
    return Estimate(value, *ends)


def quantile_interval(values: FloatArray, share: float) -> Estimate:
    """A quantile of the values (draws, halves, n) of each draw, those that are not NaN."""
    whole = quantile_of(values.reshape(len(values), -1), share)
    return interval_of(whole, quantile_of(values, share), LENGTH)


def mean_of(values: FloatArray) -> FloatArray:
    """(...): mean of (..., n), of those that are not NaN; NaN where there are none."""
    known = ~np.isnan(values)
    with np.errstate(invalid="ignore"):
        mean = np.where(known, values, 0.0).sum(axis=-1) / known.sum(axis=-1)
    return np.asarray(mean, dtype=np.float64)


def quantile_of(values: FloatArray, share: float) -> FloatArray:
    """(...): `np.nanquantile` of (..., n), which takes ten times as long."""
    ordered = np.sort(values, axis=-1)
    place = share * (np.isfinite(ordered).sum(axis=-1) - 1)
    low = np.maximum(np.floor(place).astype(np.int64), 0)
    below = np.take_along_axis(ordered, low[..., None], axis=-1)[..., 0]
    high = np.minimum(low + 1, values.shape[-1] - 1)
    above = np.take_along_axis(ordered, high[..., None], axis=-1)[..., 0]
    return np.asarray(np.where(place > low, below + (place - low) * (above - below), below))


def fcp_interval(counts: IntArray) -> Estimate:
    """The overlap of counts (draws, halves, 2, bins)."""
    merged = merge_bins(counts, MERGE)
    interval = interval_of(overlap(merged.sum(axis=1)), overlap(merged), ROOT, SHARE_SCATTER)
    return _with_limit(interval, int(counts[:, :, CORRECT].sum()))


def share_interval(cases: IntArray, of: IntArray) -> Estimate:
    """The share of cases (draws, halves), of the draws that have any; NaN if none has."""
    known = of.sum(axis=1) > 0
    cases, of = cases[known], of[known]
    if not len(of):
        return Estimate(float("nan"), float("nan"), float("nan"))
    shares = cases.sum(axis=1) / of.sum(axis=1)
    pooled = float(cases.sum() / of.sum())
    if np.mean(cases == 0) < RARELY_NONE:
        with np.errstate(invalid="ignore"):  # a half of a draw may have none
            of_halves = cases / of
        interval = interval_of(shares, of_halves, ROOT, SHARE_SCATTER)
        low, high = min(interval.low, pooled), max(interval.high, pooled)
    else:  # too few cases to tell their scatter
        low, high = (float(v) for v in np.percentile(shares, TAILS))
    return _with_limit(Estimate(pooled, low, high), int(of.sum()))


def tail_of_few(lost: Estimate, bars: int) -> Estimate:
    """The share of correct pairs lost, with an upper limit for what few bars do not show."""
    return replace(lost, high=min(lost.high * (1.0 + UNSEEN_TAIL / bars), 1.0))


def _with_limit(interval: Estimate, n: int) -> Estimate:
    """The upper limit of a share is at least 3 / n: none in n does not prove that there is none."""
    return Estimate(interval.value, max(interval.low, 0.0), max(interval.high, 3.0 / max(n, 1)))
