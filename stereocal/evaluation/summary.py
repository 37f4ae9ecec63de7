"""Summary of validation runs: PDFs, FCP, threshold, 3D error (paper, Section 6 and Fig. 4).

FCP, the false correspondence probability, is the overlap of the PDFs of log10 of the errors of
correct and of wrong pairs: 0 if they are separate, 1 if they are equal. Pairs without a value (0 or
NaN) count in the total to which the PDFs are normalised. 95 % intervals come from a bootstrap over
the runs, or over the data sets if there are several, because the runs of a data set share its
frames. For the interval of the FCP see `_fcp`. Fewer than `FEWEST_RUNS` runs show none.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import stdtrit

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.counting import (
    BIN_WIDTH,
    BINS,
    CORRECT,
    LOWEST,
    OVERFLOW,
    REPROJECTION,
    RESIDUAL,
    UNDERFLOW,
    WRONG,
)
from stereocal.evaluation.evaluate import RunCounts
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import without_nan

QUANTITIES = ("residual", "reprojection", "reconstruction")
BOOTSTRAPS = 1000
INTERVAL = (2.5, 97.5)
FEWEST_RUNS = 20
"""Of each data set, for an interval to be shown and a method to be called best. Of the sample, 150
times each, intervals of the median 3D error from 3, 5, 10 and 20 runs held 72 to 76, 82 to 84, 89
to 97 and 90 to 97 %, and that of the 2D set's FCP was 80, 29, 12 and 6 times as wide as its value:
of fewer, they say nothing."""
ACCEPTABLE = 0.01
"""3D error of 1 %: the paper's line at -2."""


@dataclass(frozen=True)
class Estimate:
    """A value with its 95 % bootstrap interval."""

    value: float
    low: float
    high: float


@dataclass(frozen=True, eq=False)
class Pdf:
    """A PDF of log10 of an error, with the numbers of values outside its bins."""

    edges: FloatArray
    """(b + 1,), log10."""
    density: FloatArray
    """(b,), per decade; its integral is the share of the values inside the bins."""
    n: int
    """Number of all values, including those outside the bins."""
    zeros: int
    """Number of values that are 0 or below the bins."""
    nans: int
    """Number of values that could not be computed."""

    @property
    def shares(self) -> FloatArray:
        """(b,): the share of all values that is in each bin."""
        return self.density * np.diff(self.edges)


@dataclass(frozen=True, eq=False)
class Discrimination:
    """How well one quantity separates correct from wrong pairs."""

    correct: Pdf
    wrong: Pdf
    fcp: Estimate
    threshold: float
    """Crossing of the PDFs, the recommended matching threshold, in the unit of the quantity."""
    correct_lost: float
    """Share of the correct pairs above the threshold."""
    wrong_let_in: float
    """Share of the wrong pairs below the threshold."""


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Length errors |D - D^R| / D of held-out bars."""

    pdf: Pdf
    median: Estimate
    p95: float
    mean: float
    fraction_above_1_percent: float
    wand_score: float
    """100 std / mean of D^R / D, which is independent of the scale."""
    mean_length_error: float
    """Mean of D^R / D - 1, the error of the scale."""


@dataclass(frozen=True, eq=False)
class MethodSummary:
    """All figures of merit of one method."""

    runs: int
    """Of each data set; the fewest, while they come."""
    residual: Discrimination
    reprojection: Discrimination
    reconstruction: Reconstruction
    angle_means: FloatArray
    """(datasets, 5), radians."""
    angle_spreads: FloatArray
    """(datasets, 5), standard deviation over the runs, radians."""

    @property
    def has_intervals(self) -> bool:
        """Whether there are enough runs for intervals."""
        return self.runs >= FEWEST_RUNS

    def main(self, quantity: str) -> Estimate:
        """FCP of the residual or of the reprojection error, or the median 3D error.

        As it is shown: the ends of its interval are NaN if there are too few runs for one.
        """
        figures = getattr(self, quantity)
        estimate: Estimate = figures.median if isinstance(figures, Reconstruction) else figures.fcp
        return estimate if self.has_intervals else replace(estimate, low=np.nan, high=np.nan)

    def to_json(self) -> dict[str, Any]:
        """The figures for `summary.json`; errors are fractions, missing values null.

        The ends of intervals are numbers for any number of runs, which stands in the settings:
        scripts compare with them.
        """
        matching, lengths = self.reprojection, self.reconstruction
        figures = {
            "fcp_residual": vars(self.residual.fcp),
            "fcp_reprojection": vars(matching.fcp),
            "threshold_residual": self.residual.threshold,
            "threshold_px": matching.threshold,
            "correct_lost_at_threshold": matching.correct_lost,
            "wrong_let_in_at_threshold": matching.wrong_let_in,
            "median_error_3d": lengths.median.value,
            "median_error_3d_interval": vars(lengths.median),
            "mean_error_3d": lengths.mean,
            "p95_error_3d": lengths.p95,
            "fraction_above_1_percent": lengths.fraction_above_1_percent,
            "wand_score_percent": lengths.wand_score,
            "mean_length_error": lengths.mean_length_error,
            "correct_pairs": matching.correct.n,
            "wrong_pairs": matching.wrong.n,
            "correct_pairs_without_value": matching.correct.nans,
            "wrong_pairs_without_value": matching.wrong.nans,
            "residuals_of_zero": self.residual.correct.zeros + self.residual.wrong.zeros,
            "reprojection_errors_of_zero": matching.correct.zeros + matching.wrong.zeros,
            "bars": lengths.pdf.n,
            "bars_without_value": lengths.pdf.nans,
            "angle_mean_rad": self.angle_means.tolist(),
            "angle_spread_rad": self.angle_spreads.tolist(),
        }
        return {name: without_nan(value) for name, value in figures.items()}


def summarise(
    runs: Sequence[Sequence[RunCounts]], bin_width: float = 0.1
) -> dict[Method, MethodSummary]:
    """Pool the runs of all data sets.

    Args:
        runs: by data set, as returned by `evaluate.evaluate`.
        bin_width: width of the bins of the PDFs in decades, a multiple of 0.02 up to 1.
    """
    if not runs or not all(runs):
        raise StereocalError("There are no runs to summarise.")
    merge = round(bin_width / BIN_WIDTH)
    if not 1 <= merge <= round(1 / BIN_WIDTH) or abs(merge * BIN_WIDTH - bin_width) > 1e-9:
        raise StereocalError(
            f"The bin width must be a multiple of {BIN_WIDTH:g} from {BIN_WIDTH:g} to 1."
        )
    rng = np.random.default_rng(0)
    # The bootstrap resamples the data sets if there are several, else the runs.
    units = [[run] for run in runs[0]] if len(runs) == 1 else [list(of_one) for of_one in runs]
    weights = rng.multinomial(len(units), np.full(len(units), 1 / len(units)), BOOTSTRAPS)
    counts = np.array(
        [np.sum([run.counts for run in unit], axis=0, dtype=np.int64) for unit in units]
    )
    nans = np.sum([run.nans for unit in units for run in unit], axis=0)
    summaries: dict[Method, MethodSummary] = {}
    for k, method in enumerate(ALL_METHODS[: counts.shape[1]]):
        summaries[method] = MethodSummary(
            runs=min(map(len, runs)),
            residual=_discrimination(
                counts[:, k, RESIDUAL], np.zeros(2, dtype=np.int64), merge, weights
            ),
            reprojection=_discrimination(counts[:, k, REPROJECTION], nans[k], merge, weights),
            reconstruction=_reconstruction(
                [np.concatenate([run.lengths[k] for run in unit]) for unit in units], merge, weights
            ),
            angle_means=np.array([_angles(of_one, k).mean(axis=0) for of_one in runs]),
            angle_spreads=np.array([_angles(of_one, k).std(axis=0) for of_one in runs]),
        )
    return summaries


def summarise_all(
    names: Sequence[str], runs: Sequence[Sequence[RunCounts]], bin_width: float = 0.1
) -> tuple[dict[Method, MethodSummary], dict[str, dict[Method, MethodSummary]]]:
    """The summary of all data sets pooled, and the summary of each by name."""
    pooled = summarise(runs, bin_width)
    if len(runs) == 1:
        return pooled, {names[0]: pooled}
    by_name = {
        name: summarise([of_one], bin_width) for name, of_one in zip(names, runs, strict=True)
    }
    return pooled, by_name


def figures_of_set(run: RunCounts) -> tuple[float, float]:
    """FCP of the reprojection error and median 3D error of a run from `evaluate.count_set`.

    NaN if there are no values.
    """
    merged = merge_bins(run.counts[0, REPROJECTION].astype(np.int64), round(0.1 / BIN_WIDTH))
    errors = np.abs(run.lengths[0] - 1)
    known = errors[np.isfinite(errors)]
    return float(overlap(merged)), float(np.median(known)) if len(known) else float("nan")


def best_methods(summaries: Mapping[Method, MethodSummary]) -> dict[str, Method]:
    """The best method for each of `QUANTITIES`."""

    def value(method: Method, quantity: str) -> float:
        return float(np.nan_to_num(summaries[method].main(quantity).value, nan=np.inf))

    return {name: min(summaries, key=partial(value, quantity=name)) for name in QUANTITIES}


def _angles(runs: Sequence[RunCounts], k: int) -> FloatArray:
    """(runs with a value, 5): angles, unwrapped so that none jumps by 360 degrees."""
    angles = np.array([run.angles[k] for run in runs])
    known = angles[np.isfinite(angles).all(axis=1)]
    return np.asarray(np.unwrap(known, axis=0)) if len(known) else np.full((1, 5), np.nan)


def _discrimination(
    counts: IntArray, nans: IntArray, merge: int, weights: IntArray
) -> Discrimination:
    """Figures of one quantity.

    Args:
        counts: (units, 2, BINS + 2); wrong, correct. The bootstrap resamples units.
        nans: (2,); wrong, correct.
        merge: number of bins that form one bin of the PDFs.
        weights: (bootstraps, units): how often each unit is drawn.
    """
    pooled = counts.sum(axis=0)
    merged = merge_bins(counts, merge)
    bin_of_threshold = int(crossing(pooled))
    total = pooled.sum(axis=1, keepdims=True)
    shares = pooled / np.where(total, total, np.nan)  # NaN without pairs
    below = shares[:, UNDERFLOW] + shares[:, :bin_of_threshold].sum(axis=1)
    return Discrimination(
        correct=_pdf(pooled[CORRECT], int(nans[CORRECT]), merge),
        wrong=_pdf(pooled[WRONG], int(nans[WRONG]), merge),
        fcp=_fcp(merged, weights),
        threshold=float(10 ** (LOWEST + bin_of_threshold * BIN_WIDTH)),
        correct_lost=float(1 - below[CORRECT]),
        wrong_let_in=float(below[WRONG]),
    )


def _fcp(counts: IntArray, weights: IntArray) -> Estimate:
    """The overlap of counts (units, 2, bins), with its 95 % interval.

    The minimum of two noisy bins is biased low, and the bootstrap adds the same bias again; the
    interval is centred on the value corrected for it. Small overlaps are not normally distributed,
    and an observed overlap of 0 does not prove a true one of 0. The interval is therefore Wilson's
    interval of a proportion. Its effective number of pairs is that which gives the variance of the
    bootstrap plus the variance of a single pair, and its factor is Student's t for the number of
    units: Wilson's for m = c (1 - c) / s^2 pairs (docs/method.md, *Evaluation*), where the share c
    is `share`, s^2 is `variance` and m is `effective`.

    Coverage, measured on 150 studies of 100 runs each (10 correct, 90 wrong pairs), for a true FCP
    of 0.76, 0.32, 0.088, 0.011, 0.0022: 94, 93, 92, 95, 97 %. The percentiles of the bootstrap
    cover 92, 93, 92, 89, 60 %.
    """
    value = float(overlap(counts.sum(axis=0)))
    filled = counts[..., counts.any(axis=(0, 1))].astype(np.float64)
    drawn = weights.astype(np.float64) @ filled.reshape(len(counts), -1)
    bootstrap = overlap(drawn.reshape(len(weights), *filled.shape[1:]))
    pairs = max(int(counts.sum(axis=(0, 2)).min()), 1)
    factor = float(stdtrit(max(len(counts) - 1, 1), 0.975)) ** 2  # 2.5 % on either side
    share = min(max(2 * value - float(bootstrap.mean()), 0.0), 1.0)
    variance = float(bootstrap.var()) + 1 / pairs**2
    effective = max(share * (1 - share), 1 / pairs) / variance
    middle = share + factor / (2 * effective)
    half = float(np.sqrt(factor * (share * (1 - share) / effective + factor / (4 * effective**2))))
    low, high = ((middle + sign * half) / (1 + factor / effective) for sign in (-1, 1))
    return Estimate(value, max(min(low, value), 0.0), min(max(high, value), 1.0))


def merge_bins(counts: IntArray, merge: int) -> IntArray:
    """Counts (..., BINS + 2) in wider bins of `merge` bins each; the last two counters stay."""
    spare = -BINS % merge
    inner = np.concatenate(
        [counts[..., :BINS], np.zeros((*counts.shape[:-1], spare), dtype=counts.dtype)], axis=-1
    )
    wide = inner.reshape(*counts.shape[:-1], -1, merge).sum(axis=-1)
    return np.concatenate([wide, counts[..., BINS:]], axis=-1)


def overlap(counts: IntArray | FloatArray) -> FloatArray:
    """The overlap (...) of pairs of histograms with counts (..., 2, bins)."""
    total = counts.sum(axis=-1, keepdims=True)
    return np.asarray((counts / np.maximum(total, 1)).min(axis=-2).sum(axis=-1))


def crossing(pooled: IntArray) -> IntArray:
    """(...): the bin at whose lower edge the PDFs of counts (..., 2, BINS + 2) cross.

    There the difference of the cumulative distributions, correct minus wrong, is largest. If the
    PDFs are separate, this holds in the whole gap, and its centre in log10 is used.
    """
    filled = np.flatnonzero(pooled[..., :BINS].reshape(-1, BINS).any(axis=0))
    first, end = (int(filled[0]), int(filled[-1]) + 1) if len(filled) else (0, BINS)
    total = np.maximum(pooled.sum(axis=-1, keepdims=True), 1)
    below = np.cumsum(pooled[..., [UNDERFLOW, *range(first, end)]], axis=-1) / total
    gain = below[..., CORRECT, :] - below[..., WRONG, :]
    best = gain >= gain.max(axis=-1, keepdims=True) - 1e-12
    lowest, highest = best.argmax(axis=-1), end - first - best[..., ::-1].argmax(axis=-1)
    return np.asarray(first + (lowest + highest) // 2)


def _pdf(counts: IntArray, nans: int, merge: int) -> Pdf:
    wide = merge_bins(counts, merge)[:-2]
    width = merge * BIN_WIDTH
    total = int(counts.sum())
    return Pdf(
        edges=np.array(LOWEST + width * np.arange(len(wide) + 1), dtype=np.float64),
        density=wide / max(total, 1) / width,
        n=total,
        zeros=int(counts[UNDERFLOW]),
        nans=nans,
    )


def _reconstruction(ratios: Sequence[FloatArray], merge: int, weights: IntArray) -> Reconstruction:
    """Figures of the lengths.

    Args:
        ratios: D^R / D of the bars of each unit that the bootstrap resamples.
        merge, weights: as in `_discrimination`.
    """
    pooled = np.concatenate(ratios)
    known = pooled[np.isfinite(pooled)]
    errors = np.abs(known - 1)
    nan = float("nan")
    if not len(known):
        all_above = np.bincount([OVERFLOW] * len(pooled), minlength=BINS + 2)
        empty = _pdf(all_above, len(pooled), merge)
        return Reconstruction(empty, Estimate(nan, nan, nan), nan, nan, nan, nan, nan)
    with np.errstate(divide="ignore"):
        index = np.floor((np.log10(errors) - LOWEST) / BIN_WIDTH)
    bins = np.where(index < 0, UNDERFLOW, np.where(index >= BINS, OVERFLOW, index)).astype(np.int64)
    counts = np.bincount(bins, minlength=BINS + 2)
    counts[OVERFLOW] += len(pooled) - len(known)
    with np.errstate(divide="ignore", invalid="ignore"):  # NaN or infinite for a mean of 0
        score = float(100 * known.std() / known.mean())
    low, high = np.percentile(_bootstrap_medians(ratios, weights), INTERVAL)
    return Reconstruction(
        pdf=_pdf(counts, len(pooled) - len(known), merge),
        median=Estimate(float(np.median(errors)), float(low), float(high)),
        p95=float(np.percentile(errors, 95)),
        mean=float(errors.mean()),
        fraction_above_1_percent=float((errors > ACCEPTABLE).mean()),
        wand_score=score,
        mean_length_error=float(known.mean() - 1),
    )


def _bootstrap_medians(ratios: Sequence[FloatArray], weights: IntArray) -> FloatArray:
    """Weighted medians of the errors, one for each row of `weights` (bootstraps, units)."""
    errors = np.concatenate([np.abs(unit - 1) for unit in ratios])
    unit_of = np.repeat(np.arange(len(ratios)), [len(unit) for unit in ratios])
    keep = np.isfinite(errors)
    order = np.argsort(errors[keep])
    values, units = errors[keep][order], unit_of[keep][order]
    medians = []
    for of_unit in weights:
        running = np.cumsum(of_unit[units])
        if running[-1]:
            medians.append(values[np.searchsorted(running, 0.5 * running[-1])])
    return np.array(medians)
