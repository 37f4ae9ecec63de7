"""How figures differ where frames follow each other: on a further recording, and between splits.

A further recording has other places, and other noise where blur or detection change. How much that
matters shows between runs of the recording at hand: the variance of the logarithm of a figure
between up to ten of them, beyond that of as many groups of frames drawn at random. A further
recording in the same volume, a third as long as this one, differs by so much from the forecast, and
by what its finite number of frames makes. Frames follow each other where their errors are alike, or
where their bars lie close together. Runs are at least as long as that lasts: shorter ones would
repeat each other, and count for more than they tell.

Of boards taken one by one, each is a run: its corners share its errors (focus, tilt, bend), and a
few boards have few of these. A further recording of half as many boards differs by what their
number makes, which boards drawn with replacement show.

The recording at hand may show other figures than the forecast: less error, where lenses and pose
follow the errors of few places or boards, more wrong pairs among the corners of a board. A further
one may show as much.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import expit, stdtrit

from stereocal.calibration.methods import METHOD_NAMES, Method, errors_of
from stereocal.errors import StereocalError
from stereocal.evaluation import evaluate
from stereocal.evaluation.summary import (
    FEWEST_RUNS,
    Estimate,
    MethodSummary,
    figures_of_set,
    summarise,
)
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.clusters import clusters_of
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.verdict.in_words import interval, percent

RUNS = 10
FEWEST = 4
"""Frames of a run, and runs."""
SHUFFLES, SHUFFLES_OF_PAIRS = 60, 6
LENGTH = 1 / 3
"""Of a further recording, over that of the one at hand."""
SPLITS = 40
"""Of the other kind of splits: half a second with 400 frames."""
MOST_FRAMES = 40_000
"""Of all of them together; longer recordings are not compared."""
SMALLEST_RATIO = 1.1
"""Of two figures that are worth telling apart."""
DRAWN = 200
FEWEST_BOARDS, MOST_GROUPS = 5, 20
LENGTH_OF_BOARDS = 1 / 2
IN_IMAGES = "mean_reprojection_px"
OF_LENGTHS: Mapping[str, Callable[..., Any]] = {
    "mean_error_3d": partial(np.mean, axis=-1),
    "median_error_3d": partial(np.median, axis=-1),
    "p95_error_3d": partial(np.percentile, q=95, axis=-1),
}
"""Figures of a forecast, of the errors in the images and of those of the lengths."""
LARGEST = float(np.log(3.0))
"""Half width in logarithms: few frames show runs that differ by far more than recordings do."""


@dataclass(frozen=True)
class Further:
    """Half widths of 95 % intervals in logarithms, for what differs between recordings."""

    in_images: float = 0.0
    of_pairs: float = 0.0
    """Of the FCP and of shares of pairs: of their logarithm where they are small."""
    of_lengths: Mapping[str, float] = field(default_factory=dict)
    """By figure."""
    shown: Mapping[str, float] = field(default_factory=dict)
    """Figures of the recording at hand, which was fitted."""

    def of(self, figure: str) -> float:
        """The half width of a figure of a forecast. Thresholds follow the errors in the images."""
        if figure in (IN_IMAGES, "threshold_px"):
            return self.in_images
        return self.of_lengths.get(figure, self.of_pairs)


def further_recordings(
    model: RefinedResult, files: Mapping[Method, Rig], seed: int = 0
) -> dict[Method, Further]:
    """How the figures of each file differ on a further recording; empty for single frames.

    The frames of the fit `model` are compared, by the sets that were written of its data set.
    """
    table = model.dataset.correspondences
    length = max(model.clusters.length, _length_of_places(model))
    if length == 1 and model.dataset.board is None:
        return {}
    order = np.argsort(table.time_frame, kind="stable")
    used = order[model.used_rows[order]]
    times, places = np.unique(table.time_frame[used], return_inverse=True)
    bars = np.flatnonzero(model.used_rows[table.bars].all(axis=1))
    bars = bars[np.argsort(table.time_frame[table.bars[bars, 0]])]
    of_bars = np.searchsorted(times, table.time_frame[table.bars[bars, 0]])
    further: dict[Method, Further] = {}
    for method, rig in files.items():
        rng = np.random.default_rng([seed, 0xF127])
        seen = _seen_by(model, rig)
        errors = errors_of(seen, rig.pose)
        px = np.bincount(places, errors.reprojection_px[used]) / np.bincount(places)
        lengths = errors.length[bars]
        if length > 1:
            in_images = half_width(px, OF_LENGTHS["mean_error_3d"], length, rng)
            of_pairs = _half_width_of_fcp(seen, rig.pose, used, places, length, rng)
            of_lengths = {
                name: half_width(lengths, figure, length, rng)
                for name, figure in OF_LENGTHS.items()
            }
        else:
            by_board = [lengths[of_bars == board] for board in range(len(times))]
            boards = [finite for board in by_board if len(finite := board[np.isfinite(board)])]
            if len(boards) < FEWEST_BOARDS:
                continue
            in_images = _half_width_of_boards([*px], np.mean, rng)
            of_pairs = _half_width_of_boards_fcp(seen, rig.pose, used, places)
            of_lengths = {
                name: _half_width_of_boards(boards, figure, rng)
                for name, figure in OF_LENGTHS.items()
            }
        # Small overlaps show little of what changes the errors.
        of_pairs = max(of_pairs, in_images)
        further[method] = Further(in_images, of_pairs, of_lengths, _shown(seen, rig, px, used))
    return further


def _shown(seen: Pair, rig: Rig, px: FloatArray, used: IntArray) -> dict[str, float]:
    """Figures of a recording, from the errors of its frames (f,) and its rows."""
    fcp = float(expit(_log_odds_of_fcp(seen, rig.pose, used)))
    return {IN_IMAGES: float(px.mean()), "fcp_reprojection": fcp}


def sentence_on_runs(model: RefinedResult) -> str:
    """What the intervals are for, where `further_recordings` widens them."""
    text = model.clusters.text
    if not text and _length_of_places(model) == 1:
        return (
            "The corners of a board share its errors: the intervals are for another recording in "
            "the same volume, of at least half as many boards."
        )
    alike = f", and neighbours have alike errors ({text})" if text else ""
    return (
        f"The frames follow each other{alike}: the intervals are for another recording in the "
        "same volume, at least a third as long."
    )


def _half_width_of_boards(
    boards: Sequence[Any], figure: Callable[..., Any], rng: np.random.Generator
) -> float:
    """Half width of the interval of a figure, with boards taken one by one: the corners of a board
    share its errors, so that a recording has as many independent ones as boards. Their errors are
    drawn with replacement."""
    n = len(boards)
    drawn = (
        np.hstack([boards[k] for k in recording]) for recording in rng.integers(n, size=(DRAWN, n))
    )
    figures = np.array([figure(errors) for errors in drawn])
    variance = float(np.log(np.maximum(figures, 1e-300)).var()) * n / (n - 1)
    return _half_width_of_finite(variance)


def _half_width_of_finite(variance: float) -> float:
    """For the finite number of boards of a further recording, from the variance of the logarithm of
    a figure by that of this one."""
    return min(1.96 * math.sqrt(variance / LENGTH_OF_BOARDS), LARGEST)


def _half_width_of_boards_fcp(seen: Pair, pose: Pose, used: IntArray, places: IntArray) -> float:
    """Half width of the interval of the FCP, from its log odds without each board, or some of many
    (jackknife).

    `used` (n,) are the rows to count, and `places` (n,) says which board each is of.
    """
    groups = np.arange(int(places.max()) + 1) % MOST_GROUPS
    odds = [
        _log_odds_of_fcp(seen, pose, used[groups[places] != group]) for group in np.unique(groups)
    ]
    return _half_width_of_finite(float(np.var(odds)) * (len(odds) - 1))


def _log_odds_of_fcp(seen: Pair, pose: Pose, chosen: IntArray) -> float:
    """The log odds of the FCP, of the pairs of some rows (r,)."""
    rows = np.zeros(len(seen.correspondences), dtype=np.bool_)
    rows[chosen] = True
    fcp = figures_of_set(evaluate.count_set(seen, pose, rows=rows))[0]
    return float(np.log((fcp * len(chosen) + 0.5) / ((1.0 - fcp) * len(chosen) + 0.5)))


def _seen_by(model: RefinedResult, rig: Rig) -> Pair:
    """The data set of a fit with the lenses and the baseline of a file."""
    return model.dataset.changed(
        primary=rig.primary, secondary=rig.secondary, baseline_m=rig.pose.baseline
    )


def _length_of_places(model: RefinedResult) -> int:
    """Number of frames over which bars lie closer together than others; 1 if they do not."""
    table, frames = model.dataset.correspondences, model.frames[~model.outlying]
    first = np.unique(table.frame, return_index=True)
    times = table.time_frame[first[1][np.searchsorted(first[0], frames)]]
    middles = model.middles_m[~model.outlying]
    places = np.column_stack([middles[:, :2] / middles[:, 2:], np.log(middles[:, 2])])
    order = np.argsort(times)
    return clusters_of(times[order], (places - np.nanmean(places, axis=0))[order]).length


def half_width(
    errors: FloatArray, figure: Callable[..., Any], length: int, rng: np.random.Generator
) -> float:
    """Half width of the interval of a figure of the errors (f,), which are in the order of time,
    and alike over a length."""
    finite = errors[np.isfinite(errors)]

    def spread(runs: int) -> tuple[float, float]:
        in_order = finite[: len(finite) // runs * runs]
        shuffled = rng.permuted(np.broadcast_to(in_order, (SHUFFLES, len(in_order))), axis=1)
        parts = figure(np.vstack([in_order, shuffled]).reshape(1 + SHUFFLES, runs, -1))
        between = np.log(np.maximum(parts, 1e-300)).var(axis=-1, ddof=1)
        return float(between[0]), float(between[1:].mean())

    return _half_width(len(finite), length, spread)


def _half_width_of_fcp(
    seen: Pair, pose: Pose, used: IntArray, places: IntArray, length: int, rng: np.random.Generator
) -> float:
    """Half width of the interval of the FCP, from its log odds.

    `used` (n,) are the rows to count, and `places` (n,) says at which place in time the frame of
    each is.
    """
    frames = int(places.max()) + 1

    def between(order: IntArray, runs: int) -> float:
        """Variance between the runs of frames in an order (f,)."""
        odds = [
            _log_odds_of_fcp(seen, pose, used[np.isin(places, run)])
            for run in np.array_split(order, runs)
        ]
        return float(np.var(odds, ddof=1))

    def spread(runs: int) -> tuple[float, float]:
        shuffled = [between(rng.permutation(frames), runs) for _ in range(SHUFFLES_OF_PAIRS)]
        return between(np.arange(frames), runs), float(np.mean(shuffled))

    return _half_width(frames, length, spread)


def _half_width(frames: int, length: int, spread: Callable[[int], tuple[float, float]]) -> float:
    """Half width for a further recording (docs/trust.md, "How it is made"); 0 if frames that are
    alike for a length are too few to be divided into runs.

    With m runs, the variance w between random groups of frames, and the excess x of that between
    runs, it is the root of t(m - 1)^2 x (3 / m + 1 / m) + 1.96^2 w 3 / m, at most a factor of 3.
    `spread` gives the variances between runs, x + w, and between random groups by the number m.
    """
    runs = min(RUNS, max(frames // length, FEWEST))
    if frames < FEWEST * runs:
        return 0.0
    between, of_frames = spread(runs)
    recordings = 1 / (runs * LENGTH)  # 3 / m
    squares = stdtrit(runs - 1, 0.975) ** 2 * max(between - of_frames, 0.0)
    squares *= recordings + 1 / runs
    return min(float(np.sqrt(squares + 1.96**2 * of_frames * recordings)), LARGEST)


def widened(estimate: Estimate, half: float, shown: float | None = None) -> Estimate:
    """An interval with a further half width in logarithms, added in quadrature on either side, and
    at least that about what was `shown`."""
    if not half or not estimate.value > 0:
        return estimate
    value, seen = estimate.value, shown or estimate.value
    down = math.log(value / estimate.low) if estimate.low > 0 else math.inf
    return replace(
        estimate,
        low=min(value * math.exp(-math.hypot(down, half)), seen * math.exp(-half)),
        high=max(
            value * math.exp(math.hypot(math.log(estimate.high / value), half)),
            seen * math.exp(half),
        ),
    )


def note_on_splits(
    dataset: Pair, settings: evaluate.EvaluationSettings, summaries: Mapping[Method, MethodSummary]
) -> str:
    """Where the other kind of splits differs from what was found beyond both intervals and by a
    tenth; else empty. Without runs in the data set nothing is computed.
    """
    runs = min(settings.runs, SPLITS, MOST_FRAMES // len(dataset.correspondences.frames))
    if runs < FEWEST_RUNS or evaluate.clusters_to_split(dataset) is None:
        return ""
    splits: evaluate.Splits = "frames" if settings.splits == "runs" else "runs"
    other = replace(settings, runs=runs, refined=None, splits=splits)
    try:
        tried = summarise([evaluate.evaluate_runs(dataset, other, 0, range(runs))])
    except StereocalError:  # a single run does not determine the pose
        return ""
    by_kind = {settings.splits: summaries, other.splits: tried}
    differences = []
    for method in ("2d", "3d"):
        single, whole = (
            (summary.reprojection.fcp, summary.reconstruction.median)
            for summary in (by_kind[kind][method] for kind in ("frames", "runs"))
        )
        differences += [
            f"{METHOD_NAMES[method]} {what} {percent(a.value)} % ({interval(a)}) instead of "
            f"{percent(b.value)} % ({interval(b)})"
            for what, a, b in zip(("FCP", "median length error"), single, whole, strict=True)
            if (a.high < b.low or b.high < a.low)
            and max(a.value, b.value) > SMALLEST_RATIO * min(a.value, b.value)
        ]
    if not differences:
        return ""
    return (
        "Frames that follow each other are alike. With single frames left out, figures differ from "
        f"those with whole runs left out: {'; '.join(differences)}. Rely on the figures of "
        "whole runs."
    )
