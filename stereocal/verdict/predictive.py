"""What the parameter files will do on frames to come.

Given the data, the truth is distributed as the refined fit says: normal, with its covariance. For
each draw of it come fresh bars (`fresh_bars`), fresh noise (`noise_model`), and every written set
is judged on the same images. No calibration is repeated. The intervals are those of the figure of
the population, for bars and frames like the recorded ones, without the scatter of a finite test.
Length errors are those of the paper: relative to distances measured as the bar was.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.evaluation.compiled_run import (
    BIN_WIDTH,
    BINS,
    CORRECT,
    LOWEST,
    REPROJECTION,
    RESIDUAL,
    UNDERFLOW,
)
from stereocal.evaluation.summary import Estimate, crossing, merge_bins, overlap
from stereocal.refined.bar_fit import BAR
from stereocal.refined.refine import RefinedResult
from stereocal.refined.solve import lenses_of, lenses_of_cameras
from stereocal.refined.unknowns import shared_unknowns
from stereocal.rig.compiled import CountArray, FloatArray, IntArray
from stereocal.rig.rig import Rig
from stereocal.verdict.fresh_bars import GROUP, fresh_bars
from stereocal.verdict.judging import judge, photograph
from stereocal.verdict.noise_model import draw_noise, epipolar_gradient, noise_of_points

DRAWS, BARS = 128, 200
"""Draws of the truth, and fresh bars of each half of a draw."""
WRONG_PARTNERS = 3
"""Wrong partners of each point, of the nine in its group."""
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
LEVEL = 0.95
TAILS = (50 * (1 - LEVEL), 100 - 50 * (1 - LEVEL))


@dataclass(frozen=True)
class Forecast:
    """The figures of one file on frames to come, each with its 95 % interval."""

    fcp_residual: Estimate
    fcp_reprojection: Estimate
    threshold_px: Estimate
    correct_lost_at_threshold: Estimate
    wrong_let_in_at_threshold: Estimate
    mean_reprojection_px: Estimate
    median_error_3d: Estimate
    p95_error_3d: Estimate
    mean_error_3d: Estimate

    def to_json(self) -> dict[str, dict[str, float | None]]:
        """Each figure as `{"value", "low", "high"}`; errors are fractions."""
        return {name: _plain(estimate) for name, estimate in vars(self).items()}


@dataclass(frozen=True, eq=False)
class Predictive:
    """All draws of the judgement of all files."""

    methods: tuple[Method, ...]
    counts: CountArray
    """(draws, halves, methods, 2, 2, BINS + 2): as in `evaluate.Run`."""
    correct_px: FloatArray
    """(draws, halves, methods): mean reprojection error of the correct pairs."""
    lengths: FloatArray
    """(draws, halves, methods, bars): D^R / D of fresh bars, D measured as the bar was."""

    @cached_property
    def errors_3d(self) -> FloatArray:
        """(draws, halves, methods, bars): |D - D^R| / D."""
        return np.abs(self.lengths - 1.0)

    @cached_property
    def forecasts(self) -> Mapping[Method, Forecast]:
        """The figures of each file."""
        return {method: self.forecast(method) for method in self.methods}

    def ratio(self, quantity: FloatArray, of: Method, to: Method) -> FloatArray:
        """(draws,): the figures of one file over those of another, on the same images.

        Args:
            quantity: (draws, halves, methods), such as `correct_px`.
        """
        a, b = self.methods.index(of), self.methods.index(to)
        whole = quantity.mean(axis=1)
        return np.asarray(whole[:, a] / whole[:, b])

    @cached_property
    def mean_errors_3d(self) -> FloatArray:
        """(draws, halves, methods)."""
        return np.asarray(np.nanmean(self.errors_3d, axis=-1))

    def forecast(self, method: Method, threshold_px: float | None = None) -> Forecast:
        """The figures of one file.

        Args:
            threshold_px: at which the shares are given; None: the recommended one.
        """
        at = self.methods.index(method)
        counts = self.counts[:, :, at].astype(np.int64)
        errors = self.errors_3d[:, :, at]
        pooled = counts.sum(axis=(0, 1))
        recommended = threshold_bin = int(crossing(pooled[REPROJECTION]))
        if threshold_px is not None:
            threshold_bin = int(np.clip(_bin_edge(threshold_px), 0, BINS))
        below = counts[..., REPROJECTION, :, UNDERFLOW] + counts[
            ..., REPROJECTION, :, :threshold_bin
        ].sum(axis=-1)
        total = counts[..., REPROJECTION, :, :].sum(axis=-1)
        lost, let_in = (total - below)[..., CORRECT], below[..., 1 - CORRECT]
        both = np.concatenate(
            [counts[:, :, REPROJECTION], counts[:, :, REPROJECTION].sum(axis=1, keepdims=True)],
            axis=1,
        )
        crossings = crossing(both)
        thresholds = np.power(10.0, LOWEST + crossings * BIN_WIDTH)
        value = float(10 ** (LOWEST + recommended * BIN_WIDTH))
        middle = _estimate(thresholds[:, 2], thresholds[:, :2], _LOG)
        return Forecast(
            fcp_residual=_fcp(counts[..., RESIDUAL, :, :]),
            fcp_reprojection=_fcp(counts[..., REPROJECTION, :, :]),
            threshold_px=Estimate(value, min(middle.low, value), max(middle.high, value)),
            correct_lost_at_threshold=_share(lost, total[..., CORRECT]),
            wrong_let_in_at_threshold=_share(let_in, total[..., 1 - CORRECT]),
            mean_reprojection_px=_estimate(
                _mean(self.correct_px[:, :, at]), self.correct_px[:, :, at], _LOG
            ),
            median_error_3d=_quantile(errors, 0.5),
            p95_error_3d=_quantile(errors, 0.95),
            mean_error_3d=_estimate(_mean(errors.reshape(len(errors), -1)), _mean(errors), _LOG),
        )


def predict(
    model: RefinedResult,
    files: Mapping[Method, Rig],
    seed: int = 0,
    draws: int = DRAWS,
    bars: int = BARS,
    workers: int = 2,
) -> Predictive:
    """Judge files on draws of the truth.

    Args:
        model: the fit whose distribution is that of the truth; its accused inputs are freed.
        files: the sets that were written, of the data set of the model.
        seed: of draws, bars and noise.
        bars: of each half of a draw.
        workers: threads.

    Raises:
        StereocalError: too few bars.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, 0x5E7]))
    methods = tuple(method for method in ALL_METHODS if method in files)
    sets = np.array([shared_unknowns(files[method]) for method in methods])
    lenses = lenses_of(model.dataset)
    of_noise = draw_noise(model, draws, rng)
    truths = _truths(model, of_noise.across, rng)
    ends = fresh_bars(model, draws, 2 * bars, rng)
    noise = noise_of_points(of_noise.degrees, 4 * bars, rng)
    noise *= (model.sigma_px.value * of_noise.across)[:, None, None]
    partners = _partners(bars, rng)
    size = (draws, 2, len(methods))
    counts = np.zeros((*size, 2, 2, BINS + 2), dtype=np.int32)
    nans = np.zeros((*size, 2), dtype=np.int64)
    correct_px, lengths = np.empty(size), np.empty((*size, bars))

    def judge_draw(draw: int) -> None:
        points = np.ascontiguousarray(ends[draw].reshape(-1, 3))
        pixels = np.empty((len(points), 4))
        photograph(truths[draw], lenses, points, pixels)
        distances = np.linalg.norm(ends[draw, :, 0] - ends[draw, :, 1], axis=1)
        distances /= truths[draw, BAR]  # as measured, with the error of the bar at hand
        seen = model.pose.apply(points)
        one, two = points / points[:, 2:], seen / seen[:, 2:]
        start = np.column_stack([one[:, :2], two[:, :2]])
        across = epipolar_gradient(model, one, two)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        across *= np.sum(across * noise[draw], axis=1, keepdims=True)
        noise[draw] = across + of_noise.along[draw] * (noise[draw] - across)
        for half in range(2):
            own = slice(2 * bars * half, 2 * bars * (half + 1))
            judge(
                sets, lenses, pixels[own] + noise[draw, own],
                np.ascontiguousarray(start[own].T), distances[bars * half : bars * (half + 1)],
                partners, counts[draw, half], nans[draw, half], lengths[draw, half],
                correct_px[draw, half],
            )  # fmt: skip

    with ThreadPoolExecutor(workers) as pool:
        list(pool.map(judge_draw, range(draws)))
    return Predictive(methods, counts, correct_px, lengths)


def population(
    truth: Rig,
    files: Mapping[Method, Rig],
    ends_m: FloatArray,
    noise_px: float,
    thresholds: Mapping[Method, float],
    rng: np.random.Generator,
    bar_factor: float = 1.0,
) -> dict[Method, dict[str, float]]:
    """The figures of files on a large test whose truth is known, under the names of `Forecast`.

    Args:
        truth: the true cameras, with the distortion model of the files.
        ends_m: (bars, 2, 3), in metres.
        noise_px: standard deviation of a pixel coordinate.
        thresholds: in pixels, for the shares.
        bar_factor: true over measured lengths.
    """
    methods = tuple(method for method in ALL_METHODS if method in files)
    bars = len(ends_m)
    points = np.ascontiguousarray(ends_m.reshape(-1, 3))
    seen = truth.pose.apply(points)
    pixels = np.column_stack([truth.primary.project(points), truth.secondary.project(seen)])
    pixels += noise_px * rng.standard_normal(pixels.shape)
    start = np.column_stack([points[:, :2] / points[:, 2:], seen[:, :2] / seen[:, 2:]])
    counts = np.zeros((len(methods), 2, 2, BINS + 2), dtype=np.int32)
    nans, lengths = np.zeros((len(methods), 2), dtype=np.int64), np.empty((len(methods), bars))
    correct_px = np.empty(len(methods))
    any_file = next(iter(files.values()))
    judge(
        np.array([shared_unknowns(files[method]) for method in methods]),
        lenses_of_cameras(any_file.primary, any_file.secondary),
        pixels, np.ascontiguousarray(start.T),
        np.linalg.norm(ends_m[:, 0] - ends_m[:, 1], axis=1) / bar_factor,
        _partners(bars, rng, 2 * GROUP - 1),
        counts, nans, lengths, correct_px,
    )  # fmt: skip
    found = {}
    for at, method in enumerate(methods):
        merged = overlap(merge_bins(counts[at].astype(np.int64), MERGE))
        limit = _bin_edge(thresholds[method])
        of_px = counts[at, REPROJECTION].astype(np.int64)
        below = of_px[:, UNDERFLOW] + of_px[:, :limit].sum(axis=1)
        share = below / of_px.sum(axis=1)
        errors = np.abs(lengths[at] - 1.0)
        found[method] = {
            "fcp_residual": float(merged[RESIDUAL]),
            "fcp_reprojection": float(merged[REPROJECTION]),
            "correct_lost_at_threshold": float(1.0 - share[CORRECT]),
            "wrong_let_in_at_threshold": float(share[1 - CORRECT]),
            "mean_reprojection_px": float(correct_px[at]),
            "median_error_3d": float(np.nanmedian(errors)),
            "p95_error_3d": float(np.nanpercentile(errors, 95)),
            "mean_error_3d": float(np.nanmean(errors)),
        }
    return found


def _bin_edge(threshold_px: float) -> int:
    """The bin at whose lower edge a threshold lies."""
    return round((math.log10(max(threshold_px, 1e-300)) - LOWEST) / BIN_WIDTH)


def _truths(model: RefinedResult, scales: FloatArray, rng: np.random.Generator) -> FloatArray:
    """(draws, 23): draws of the shared unknowns; the covariance grows with the drawn noise."""
    M, k = model.unknowns.M, len(model.unknowns.names)
    of_images = M.T @ model.information @ M
    found = np.empty((len(scales), len(M)))
    for own, scale in zip(found, scales, strict=True):
        A = of_images / scale**2 + model.unknowns.precision
        unit = 1.0 / np.sqrt(np.diag(A))
        root = np.linalg.cholesky(A * np.outer(unit, unit))
        own[:] = model.q + M @ (unit * np.linalg.solve(root.T, rng.standard_normal(k)))
    return found


def _partners(
    bars: int, rng: np.random.Generator, wrong_partners: int = WRONG_PARTNERS
) -> IntArray:
    """(2 bars, 1 + wrong): for each point itself and random others of its group of frames."""
    points, group = 2 * bars, 2 * GROUP
    steps = np.stack([rng.permutation(group - 1)[:wrong_partners] + 1 for _ in range(points)])
    first = np.arange(points) // group * group
    wrong = first[:, None] + (np.arange(points)[:, None] - first[:, None] + steps) % group
    wrong = np.minimum(wrong, points - 1)
    return np.column_stack([np.arange(points), wrong]).astype(np.int64)


@dataclass(frozen=True)
class _Scale:
    """A transformation in which the scatter of a finite sample hardly depends on the value."""

    to: Callable[[Any], Any]
    back: Callable[[Any], Any]


_LOG = _Scale(np.log, np.exp)
_ROOT = _Scale(np.sqrt, np.square)


def _estimate(
    whole: FloatArray, halves: FloatArray, scale: _Scale, removed: float = 1.0
) -> Estimate:
    """Median and 95 % interval over draws, without the scatter of the finite number of bars.

    The difference of two halves shows that scatter; the draws are shrunk by its share.

    Args:
        whole: (draws,); `halves`: (draws, 2).
        removed: the part of the scatter between the halves to remove.
    """
    known = np.isfinite(whole) & np.isfinite(halves).all(axis=1)
    if known.sum() < 2:
        return Estimate(float("nan"), float("nan"), float("nan"))
    with np.errstate(divide="ignore"):
        each = np.maximum(scale.to(whole[known]), -700.0)
        parts = np.maximum(scale.to(halves[known]), -700.0)
    of_sample = float(np.mean(np.square(parts[:, 0] - parts[:, 1]))) / 4.0
    total = float(each.var())
    kept = np.sqrt(max(1.0 - removed * of_sample / total, 0.0)) if total > 0 else 0.0
    middle = float(each.mean())
    shrunk = middle + kept * (WIDER if scale is _LOG else 1.0) * (each - middle)
    low, value, high = (
        float(scale.back(v)) for v in np.percentile(shrunk, (TAILS[0], 50, TAILS[1]))
    )
    return Estimate(value, low, high)


def _quantile(values: FloatArray, share: float) -> Estimate:
    """A quantile of the values (draws, halves, n) of each draw, those that are not NaN."""
    whole, halves = (
        _quantile_of(each, share) for each in (values.reshape(len(values), -1), values)
    )
    return _estimate(whole, halves, _LOG)


def _mean(values: FloatArray) -> FloatArray:
    """(...): mean of (..., n), of those that are not NaN."""
    return np.asarray(np.nanmean(values, axis=-1), dtype=np.float64)


def _quantile_of(values: FloatArray, share: float) -> FloatArray:
    """(...): `np.nanquantile` of (..., n), which takes ten times as long."""
    ordered = np.sort(values, axis=-1)
    place = share * (np.isfinite(ordered).sum(axis=-1) - 1)
    low = np.maximum(np.floor(place).astype(np.int64), 0)
    at = np.take_along_axis(ordered, low[..., None], axis=-1)[..., 0]
    high = np.minimum(low + 1, values.shape[-1] - 1)
    above = np.take_along_axis(ordered, high[..., None], axis=-1)[..., 0]
    return np.asarray(np.where(place > low, at + (place - low) * (above - at), at))


def _fcp(counts: IntArray) -> Estimate:
    """The overlap of counts (draws, halves, 2, bins)."""
    merged = merge_bins(counts, MERGE)
    found = _estimate(overlap(merged.sum(axis=1)), overlap(merged), _ROOT, SHARE_SCATTER)
    return _with_limit(found, int(counts[:, :, CORRECT].sum()))


def _share(cases: IntArray, of: IntArray) -> Estimate:
    """The share of cases (draws, halves)."""
    shares = cases.sum(axis=1) / of.sum(axis=1)
    pooled = float(cases.sum() / of.sum())
    if np.mean(cases == 0) < RARELY_NONE:
        found = _estimate(shares, cases / of, _ROOT, SHARE_SCATTER)
        low, high = min(found.low, pooled), max(found.high, pooled)
    else:  # too few cases to tell their scatter
        low, high = (float(v) for v in np.percentile(shares, TAILS))
    return _with_limit(Estimate(pooled, low, high), int(of.sum()))


def _with_limit(found: Estimate, n: int) -> Estimate:
    """The upper limit of a share is at least 3 / n: none in n does not prove that there is none."""
    return Estimate(found.value, max(found.low, 0.0), max(found.high, 3.0 / max(n, 1)))


def _plain(estimate: Estimate) -> dict[str, float | None]:
    return {key: v if np.isfinite(v) else None for key, v in vars(estimate).items()}
