"""What the parameter files will do on frames to come.

Given the data, the truth is distributed as the refined fit says: normal, with its covariance. For
each draw of it come fresh bars and noise (`fresh_frames`), and every written set
is judged on the same images. No calibration is repeated. The intervals are those of the figure of
the population, for bars and frames like the recorded ones, without the scatter of a finite test.
Length errors are those of the paper, relative to distances measured as the bar was; `metric` ones
are of lengths in metres, which have the error of the bar as well. All lengths share that, so that
no held-out bar shows it.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.evaluation import counting
from stereocal.evaluation.summary import Estimate, crossing
from stereocal.fit.least_squares.design_effect import lenses_without
from stereocal.fit.least_squares.small_steps import FACTOR, moved, rig_at
from stereocal.fit.least_squares.views import Cameras
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.rig import Rig
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import without_nan
from stereocal.verdict import intervals
from stereocal.verdict.fresh_frames import GROUP, draw_noise, fresh_bars, noise_of_points
from stereocal.verdict.further_recording import Further, further_recordings, widened
from stereocal.verdict.judging import JudgedSets, add_noise, judge, judge_behind_windows, photograph

DRAWS, BARS = 128, 200
"""Draws of the truth, and fresh bars of each half of a draw."""
OWN_STREAM = 0x5E7
"""Sets these random numbers apart from others of the same seed."""
WRONG_PARTNERS = 3
"""Wrong partners of each point, of the nine in its group."""


@dataclass(frozen=True)
class ForecastFigures:
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
    p95_metric_error_3d: Estimate
    """Of lengths in metres: 95 % of all draws and bars together, with the error of the bar."""

    def to_json(self) -> dict[str, dict[str, float | None]]:
        """Each figure as `{"value", "low", "high"}`; errors are fractions."""
        return {name: without_nan(vars(estimate)) for name, estimate in vars(self).items()}

    def further(self, spread: Further) -> "ForecastFigures":
        """With the intervals widened to what a further recording may show."""
        return self._changed(
            lambda name, figure: widened(figure, spread.of(name), spread.shown.get(name))
        )

    def raised(self, in_images: float, in_length: float) -> "ForecastFigures":
        """With the upper ends of the intervals multiplied by these factors; shares by the first."""
        return self._changed(
            lambda name, figure: replace(
                figure, high=figure.high * (in_length if name.endswith("_3d") else in_images)
            )
        )

    def _changed(self, change: Callable[[str, Estimate], Estimate]) -> "ForecastFigures":
        """With another interval of each figure; no share is above 1."""
        changed = {name: change(name, figure) for name, figure in vars(self).items()}
        shares = {
            name: replace(figure, high=min(figure.high, 1.0))
            for name, figure in changed.items()
            if not name.endswith(("_3d", "_px"))
        }
        return ForecastFigures(**{**changed, **shares})


@dataclass(frozen=True, eq=False)
class ForecastDraws:
    """All draws of the judgement of all files."""

    methods: tuple[Method, ...]
    counts: npt.NDArray[np.uint16]
    """(draws, halves, methods, 2, 2, BINS + 2): as in `evaluate.RunCounts`."""
    correct_px: FloatArray
    """(draws, halves, methods): mean reprojection error of the correct pairs."""
    lengths: FloatArray
    """(draws, halves, methods, bars): D^R / D of fresh bars, D measured as the bar was."""
    depths: FloatArray
    """(draws, halves, bars): mean depth of the ends of a bar in the primary camera, in metres."""
    radii: FloatArray
    """(draws, halves, bars): the mean of `image_radii` of its ends."""
    recorded: int
    """Bars of the recording."""
    bar_factors: FloatArray
    """(draws,): the true over the stated length of the bar."""
    further: Mapping[Method, Further] = field(default_factory=dict)
    """What differs on a further recording; empty for frames taken one by one."""
    excess: tuple[float, float] = (1.0, 1.0)
    """Errors on held-out frames over the forecast, in the images and in length, where chance does
    not explain them; the upper ends of the intervals are raised by them."""

    @cached_property
    def errors_3d(self) -> FloatArray:
        """(draws, halves, methods, bars): |D - D^R| / D."""
        return np.abs(self.lengths - 1.0)

    @cached_property
    def bar_p95(self) -> float:
        """The error of the bar that 95 % of the draws are within, a fraction: of all lengths."""
        return float(np.percentile(np.abs(1.0 / self.bar_factors - 1.0), 95))

    @cached_property
    def figures(self) -> Mapping[Method, ForecastFigures]:
        return {method: self.figures_of(method) for method in self.methods}

    def ratio(self, quantity: FloatArray, of: Method, to: Method) -> FloatArray:
        """(draws,): a quantity (draws, halves, methods) of one file over that of another."""
        a, b = self.methods.index(of), self.methods.index(to)
        whole = quantity.mean(axis=1)
        return np.asarray(whole[:, a] / whole[:, b])

    @cached_property
    def mean_errors_3d(self) -> FloatArray:
        """(draws, halves, methods)."""
        return intervals.mean_of(self.errors_3d)

    def mean_length_error(self, method: Method, among: BoolArray) -> float:
        """Mean length error of the bars in a mask like `depths`; NaN if there are none."""
        errors = self.errors_3d[:, :, self.methods.index(method)][among]
        return float(np.nanmean(errors)) if np.isfinite(errors).any() else float("nan")

    @cached_property
    def _known(self) -> dict[tuple[Method, float | None], ForecastFigures]:
        return {}

    def figures_of(self, method: Method, threshold_px: float | None = None) -> ForecastFigures:
        """The figures of one file.

        Args:
            threshold_px: at which the shares are given; None: the recommended one.
        """
        key = method, threshold_px
        if key not in self._known:
            self._known[key] = self._figures_of(method, threshold_px)
        return self._known[key]

    def _figures_of(self, method: Method, threshold_px: float | None) -> ForecastFigures:
        """`figures_of`, computed; d draws, of 2 halves."""
        k = self.methods.index(method)
        counts, errors = self.counts[:, :, k].astype(np.int64), self.errors_3d[:, :, k]
        # (d, 2, 2, BINS + 2): of reprojection errors, of wrong and of correct pairs.
        of_px, correct_px = counts[:, :, counting.REPROJECTION], self.correct_px[:, :, k]
        recommended = int(crossing(of_px.sum(axis=(0, 1))))  # a bin, as `limit`
        limit = recommended if threshold_px is None else bin_of_threshold(threshold_px)
        below = of_px[..., counting.UNDERFLOW] + of_px[..., :limit].sum(axis=-1)
        total = of_px.sum(axis=-1)
        lost = (total - below)[..., counting.CORRECT]
        # (d, 3): the thresholds in px of each half, and of both halves together.
        halves_and_both = np.concatenate([of_px, of_px.sum(axis=1, keepdims=True)], axis=1)
        exponents = counting.LOWEST + crossing(halves_and_both) * counting.BIN_WIDTH
        thresholds = np.power(10.0, exponents)
        # The recommended one is of all draws together; that of each draw gives its interval.
        value = float(10 ** (counting.LOWEST + recommended * counting.BIN_WIDTH))
        of_draws = intervals.interval_of(thresholds[:, 2], thresholds[:, :2], intervals.LOG)
        mean_of_draws = intervals.mean_of(errors.reshape(len(errors), -1))
        figures = ForecastFigures(
            fcp_residual=intervals.fcp_interval(counts[:, :, counting.RESIDUAL]),
            fcp_reprojection=intervals.fcp_interval(of_px),
            threshold_px=Estimate(value, min(of_draws.low, value), max(of_draws.high, value)),
            correct_lost_at_threshold=intervals.tail_of_few(
                intervals.share_interval(lost, total[..., counting.CORRECT]), self.recorded
            ),
            wrong_let_in_at_threshold=intervals.share_interval(
                below[..., counting.WRONG], total[..., counting.WRONG]
            ),
            mean_reprojection_px=intervals.interval_of(
                intervals.mean_of(correct_px), correct_px, intervals.LOG
            ),
            median_error_3d=intervals.quantile_interval(errors, 0.5),
            p95_error_3d=intervals.quantile_interval(errors, 0.95),
            mean_error_3d=intervals.interval_of(
                mean_of_draws, intervals.mean_of(errors), intervals.LENGTH
            ),
            p95_metric_error_3d=Estimate(math.nan, math.nan, math.nan),
        )
        figures = figures.further(self.further.get(method, Further())).raised(*self.excess)
        return replace(figures, p95_metric_error_3d=self._metric_p95(k, figures.p95_error_3d))

    def _metric_p95(self, k: int, of_bar: Estimate) -> Estimate:
        """95 % of the errors of lengths in metres, of one file.

        Args:
            of_bar: the same relative to the bar, whose interval the error of the bar widens.
        """
        lengths = self.lengths[:, :, k] / self.bar_factors[:, None, None]
        value = float(intervals.quantile_of(np.abs(lengths - 1.0).ravel(), 0.95))
        added = math.sqrt(max(value**2 - of_bar.value**2, 0.0))  # what the bar adds
        low, high = (math.hypot(end, added) for end in (of_bar.low, of_bar.high))
        return Estimate(value, min(low, value), max(high, value))


def image_radii(rig: RefinedResult, pixels: FloatArray) -> FloatArray:
    """(n,): distance of pixels (n, 4) from the image centre over the half diagonal, the larger of
    both images."""
    halves = 0.5 * np.array([rig.primary.image_size, rig.secondary.image_size])
    away = (pixels.reshape(-1, 2, 2) - (halves - 0.5)) / np.linalg.norm(halves, axis=1)[:, None]
    squares = np.einsum("nck,nck->nc", away, away)
    return np.asarray(np.sqrt(np.maximum(squares[:, 0], squares[:, 1])))


def draw_forecast(
    model: RefinedResult,
    files: Mapping[Method, Rig],
    seed: int = 0,
    draws: int = DRAWS,
    bars: int = BARS,
    workers: int = 2,
    knowledge: RefinedResult | None = None,
) -> ForecastDraws:
    """Judge files on draws of the truth.

    Args:
        model: the fit whose distribution is that of the truth; its accused inputs are freed.
        files: the sets that were written, of the data set of the model.
        bars: of each half of a draw.
        workers: threads.
        knowledge: the same fit with other information about its parameters.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, OWN_STREAM]))
    methods = tuple(method for method in ALL_METHODS if method in files)
    rigs = [files[method] for method in methods]
    sets = list(map(rig_at, rigs))
    drawn = _draw_recordings(model, knowledge, draws, 2 * bars, rng)
    partners = partners_in_groups(bars, rng)

    def judge_draw(draw: int) -> tuple[FloatArray, list[JudgedSets]]:
        """The pixels (4 bars, 4), with noise, of the ends of the 2 bars of a draw in turn, and what
        `judge` finds in each half of them."""
        pixels, rays = drawn.photographs(draw, model.rig)
        halves = []
        for first in (0, bars):
            of_half = slice(first, first + bars)
            ends = slice(2 * first, 2 * (first + bars))  # A and B of each bar
            initial_rays = np.ascontiguousarray(rays[:, ends])  # near those of the pixels
            distances = drawn.distances[draw, of_half]
            if model.rig.has_windows:
                halves.append(judge_behind_windows(rigs, pixels[ends], distances, partners))
            else:
                halves.append(judge(sets, pixels[ends], initial_rays, distances, partners))
        return pixels, halves

    with ThreadPoolExecutor(workers) as pool:
        pixels, judged = zip(*pool.map(judge_draw, range(draws)), strict=True)
    counts, lengths, correct_px = (
        np.array([[getattr(half, name) for half in halves] for halves in judged])
        for name in JudgedSets._fields
    )
    by_bar = (draws, 2, bars, 2)  # draw, half, bar, end
    radii = image_radii(model, np.concatenate(pixels)).reshape(by_bar).mean(axis=-1)
    return ForecastDraws(
        methods,
        counts.astype(np.uint16),
        correct_px,
        lengths,
        depths=drawn.ends[..., 2].reshape(by_bar).mean(axis=-1),
        radii=radii,
        recorded=int(np.isfinite(model.used_points_m).all(axis=(1, 2)).sum()),
        bar_factors=drawn.bar_factors,
        further=further_recordings(model, files, seed),
    )


class _Recordings(NamedTuple):
    """Recordings that may come, one of b bars in each of d draws of the truth."""

    truths: Sequence[Cameras]
    """d, of two cameras."""
    bar_factors: FloatArray
    """(d,): the true over the stated length of the bar."""
    ends: FloatArray
    """(d, b, 2, 3): A and B of each bar in the primary's frame, in metres."""
    distances: FloatArray
    """(d, b): lengths of the bars as they are measured, with the error of the bar at hand: |A - B|
    over `bar_factors`."""
    noise: FloatArray
    """(d, 2 b, 4): of u, v in both images of each end, px."""
    along: FloatArray
    """(d,): noise along the epipolar lines over that across them."""

    def photographs(self, draw: int, rig: Rig) -> tuple[FloatArray, FloatArray]:
        """Pixels (2 b, 4) with noise of all ends in a draw, and their rays (4, 2 b) without.

        Args:
            rig: whose epipolar lines tell the noise along from that across.
        """
        points = self.ends[draw].reshape(-1, 3)
        pixels = np.empty((len(points), 4))
        photograph(self.truths[draw], points, pixels)
        rays = add_noise(rig, points, self.along[draw], self.noise[draw], pixels)
        return pixels, rays


def _draw_recordings(
    model: RefinedResult,
    knowledge: RefinedResult | None,
    draws: int,
    bars: int,
    rng: np.random.Generator,
) -> _Recordings:
    """Draw recordings with this number of bars; the models are those of `draw_forecast`."""
    of_noise = draw_noise(model, draws, rng)
    truths = _truths(knowledge or model, of_noise.across, rng, knowledge is None)
    ends = fresh_bars(model, draws, bars, rng)
    noise = noise_of_points(of_noise.degrees, 2 * bars, rng)
    noise *= (model.sigma_px.value * of_noise.across)[:, None, None]
    bar = ends[:, :, 0] - ends[:, :, 1]
    bar_factors = np.array([truth.q[FACTOR] for truth in truths])
    distances = np.sqrt(np.einsum("dbk,dbk->db", bar, bar)) / bar_factors[:, None]
    return _Recordings(truths, bar_factors, ends, distances, noise, of_noise.along)


def bin_of_threshold(threshold_px: float) -> int:
    """The bin at whose lower edge a threshold lies."""
    decades = math.log10(max(threshold_px, 1e-300)) - counting.LOWEST
    return min(max(round(decades / counting.BIN_WIDTH), 0), counting.BINS)


def _truths(
    model: RefinedResult, scales: FloatArray, rng: np.random.Generator, of_boards: bool
) -> list[Cameras]:
    """Draws of the cameras; the covariance grows with the drawn noise.

    A draw moves the free parameters of the fit by p = A^-1/2 z, z standard normal, where the
    information A = I / scale^2 + P is that of the images and lengths, I, with noise that is
    `scale` times the estimated, and that of the priors, P. With A = u^-1 L L^T u^-1, u scaling the
    diagonal to 1, p = u L^-T z. (Scaled, since metres and pixels stand in one matrix.)

    Args:
        scales: (d,): drawn over estimated noise.
        of_boards: whether lenses that were calibrated from the same boards are taken for what they
            are: then A is the inverse of `p_covariance` over the squared scale, with no prior.
    """
    M, k = model.unknowns.M, len(model.unknowns.names)
    of_images = M.T @ model.information @ M / model.design_effect
    prior = model.unknowns.precision
    if of_boards and lenses_without(model.dataset, model.settings):
        unit = np.sqrt(np.diag(model.p_covariance))
        correlation = model.p_covariance / np.outer(unit, unit)
        scaled = np.linalg.inv(correlation)
        of_images = 0.5 * (scaled + scaled.T) / np.outer(unit, unit)
        prior = np.zeros((k, k))
    truths = list[Cameras]()
    for scale in scales:
        A = of_images / scale**2 + prior
        unit = 1.0 / np.sqrt(np.diag(A))
        L = np.linalg.cholesky(A * np.outer(unit, unit))
        step = unit * np.linalg.solve(L.T, rng.standard_normal(k))
        truths.append(moved(model.at, M @ step))
    return truths


def partners_in_groups(
    bars: int, rng: np.random.Generator, wrong_partners: int = WRONG_PARTNERS
) -> IntArray:
    """(2 bars, 1 + wrong): for each point itself and random others of its group of frames."""
    points, group = 2 * bars, 2 * GROUP  # points, and points of a group: two ends of each bar
    # From 1 to group - 1 places further within the group, begun again at its end: never itself.
    steps = np.stack([rng.permutation(group - 1)[:wrong_partners] + 1 for _ in range(points)])
    point = np.arange(points)
    first = (point // group * group)[:, None]  # of its group
    wrong = first + (point[:, None] - first + steps) % group
    wrong = np.minimum(wrong, points - 1)  # a last group that is not full
    return np.column_stack([point, wrong]).astype(np.int64)
