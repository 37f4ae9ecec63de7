"""Hold a forecast against errors on held-out frames, overall and by place.

The refined method is repeated on five parts of the recording, each time without one fifth of the
frames, whole runs where frames follow each other, so that every frame is held out once. Its errors
there are compared with the forecast of the refined file: all frames, near and far ones, and those
in the inner and the outer half of the images. Where they are larger than chance explains, the model
lacks something.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stereocal.calibration.methods import errors_of
from stereocal.errors import StereocalError
from stereocal.evaluation.summary import Estimate
from stereocal.fit.errors.uncertainty import Innovations, bar_innovations
from stereocal.fit.least_squares.noise import ESTIMATED
from stereocal.fit.least_squares.robust import SMALLEST_SCATTER
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.pair import Pair
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import rounded
from stereocal.verdict.forecast_draws import ForecastDraws, image_radii

FOLDS = 5
MINIMUM_FRAMES = 15
DOUBTED = 3.2
"""Standard errors by which held-out errors exceed the forecast, from which on the model is
doubted: with ten comparisons, 1 sound rig in 100."""
SMALLEST_EXCESS = 1.15
"""An excess below this factor is reported, but changes no decision."""
CAUTIOUS_BELOW = 0.75
NOISE_EXCESS = 1.5
MINIMUM_ERRORS = 5
"""Of a place, for a comparison."""
TELLING = 3.0
"""Difference of two log-likelihoods that tells one cause from the other."""
FACTORS = np.geomspace(0.05, 20.0, 50)
IN_IMAGES, IN_LENGTH = "in the images", "in length"
BENDS = "alike near and far, as of a bar that bends or of targets that move on it"
ALONG = "most where they are least certain, as of blur by motion or of cameras out of step"
UNCLEAR = "these bars cannot tell whether the bar bends or the points are less exact"
PLACES = ("in the near half", "in the far half", "near the image centres", "near the image edges")


@dataclass(frozen=True)
class HeldOutRatio:
    """Mean error on held-out frames over the forecast one, at one place."""

    where: str
    """Empty for all frames."""
    what: str
    ratio: float
    standard_errors: float
    """By which the logarithm of the ratio exceeds 0; of a half, by which it exceeds the other."""

    @property
    def holds(self) -> bool:
        """Whether chance explains the excess, or it is too small to matter."""
        return not (self.ratio > SMALLEST_EXCESS and self.standard_errors > DOUBTED)


@dataclass(frozen=True)
class ModelCheck:
    """Whether the model explains the images."""

    matching: HeldOutRatio
    """Reprojection errors of all frames."""
    measuring: HeldOutRatio
    """Length errors of all bars."""
    places: tuple[HeldOutRatio, ...]
    notes: tuple[str, ...] = ()
    """What else is known of the noise, for the user."""

    @property
    def _failed(self) -> list[HeldOutRatio]:
        comparisons = (self.matching, self.measuring, *self.places)
        return [comparison for comparison in comparisons if not comparison.holds]

    @property
    def worst(self) -> HeldOutRatio:
        """The comparison with the clearest excess, of those that fail."""
        return max(self._failed, key=lambda comparison: comparison.standard_errors)

    @property
    def holds(self) -> bool:
        """Whether no error is larger than the forecast beyond chance."""
        return not self._failed

    @property
    def excess(self) -> tuple[float, float]:
        """The largest significant excess in the images and in length, each at least 1."""
        failed = self._failed
        images, length = (
            max([1.0, *(comparison.ratio for comparison in failed if comparison.what == what)])
            for what in (IN_IMAGES, IN_LENGTH)
        )
        return images, length

    @property
    def text(self) -> str:
        """What was found, for the user."""
        overall = (
            f"errors on held-out frames are {self.matching.ratio:.2f} times the forecast in the "
            f"images and {self.measuring.ratio:.2f} times in length"
        )
        if self.holds:
            cautious = " The forecast of lengths is cautious here."
            sentence = f"Checked: {overall}.{cautious * (self.measuring.ratio < CAUTIOUS_BELOW)}"
        else:
            worst = self.worst
            place = f" ({worst.ratio:.2f} times {worst.where}, {worst.what})" if worst.where else ""
            sentence = (
                f"The model does not explain these images: {overall}{place}. Likely causes: a "
                "wrong distortion, a lens file too sure of itself, cameras out of step. The upper "
                "ends of the intervals are raised by these factors."
            )
        return " ".join([sentence, *self.notes])


class _Ratio(NamedTuple):
    """Mean of held-out errors over the forecast one."""

    value: float
    """NaN where the errors are few."""
    spread: float
    """Standard error of its logarithm."""


@dataclass(frozen=True, eq=False)
class _HeldOut:
    """Held-out errors, to be compared with the forecast of the same places."""

    px: FloatArray
    """(n,): reprojection errors of the pairs."""
    lengths: FloatArray
    """(m,): length errors of the bars."""
    bars: IntArray
    """(m, 2): the pairs at the ends of each bar."""
    clusters: IntArray
    """(n,): the cluster of each pair, within which errors are alike."""
    draws: ForecastDraws
    of_bar: float
    """Mean length error by a bar that bends, which is added to the forecast one."""

    def over_forecast(
        self, pairs: BoolArray, bars: BoolArray, drawn: BoolArray
    ) -> tuple[_Ratio, _Ratio]:
        """Errors over the forecast in the images, of the pairs (n,), and in length, of the bars
        (m,); `drawn` says which bars of the draws are at these places, like `ForecastDraws.depths`.
        """
        forecast_px = self.draws.figures["refined"].mean_reprojection_px.value
        length = float(np.hypot(self.draws.mean_length_error("refined", drawn), self.of_bar))
        return (
            _ratio(self.px[pairs], forecast_px, self.clusters[pairs]),
            _ratio(self.lengths[bars], length, self.clusters[self.bars[:, 0]][bars]),
        )

    def by_halves(
        self, names: tuple[str, str], of_pairs: FloatArray, drawn: FloatArray
    ) -> Iterator[HeldOutRatio]:
        """The inner half of the places against the outer one, divided at the median of a measure of
        the pairs (n,), such as their depth; `drawn` is that of the bars of the draws."""
        middle = np.median(of_pairs)
        of_bars = of_pairs[self.bars].mean(axis=1)
        near_pairs, near_bars, near_drawn = (
            measure <= middle for measure in (of_pairs, of_bars, drawn)
        )
        inner = self.over_forecast(near_pairs, near_bars, near_drawn)
        outer = self.over_forecast(~near_pairs, ~near_bars, ~near_drawn)
        for what, near, far in zip((IN_IMAGES, IN_LENGTH), inner, outer, strict=True):
            more = float(np.log(far.value / near.value) / np.hypot(near.spread, far.spread))
            yield HeldOutRatio(names[0], what, near.value, -more)
            yield HeldOutRatio(names[1], what, far.value, more)


def check_model(
    refined: RefinedResult, model: RefinedResult, draws: ForecastDraws
) -> ModelCheck | None:
    """Compare the forecast of the refined file with held-out frames; None with too few frames.

    `refined` is the fit of the file, `model` that behind the forecast, with accused inputs freed.
    """
    data = refined.dataset.of_frames(refined.frames[~refined.outlying])
    errors = _held_out_errors(data, refined.clusters.of_frames, refined)
    if errors is None:
        return None
    px, lengths = errors
    table, innovations = data.correspondences, bar_innovations(model, model.used_rows)
    bends = model.scatter_m.value if cause_of_scatter(model, innovations) == BENDS else 0.0
    of_bar = 0.8 * bends / data.target_distance_m  # the mean of |N| is 0.8
    clusters = np.arange(len(table))
    if refined.clusters.has_runs:
        clusters = refined.clusters.of_frames[np.searchsorted(table.frames, table.frame)]
    held_out = _HeldOut(px, lengths, table.bars, clusters, draws, of_bar)

    figures = draws.figures["refined"]
    in_images, in_length = held_out.over_forecast(
        np.isfinite(px), np.isfinite(lengths), np.isfinite(draws.depths)
    )
    depths = refined.points_m[refined.dataset.correspondences.parts][refined.used_rows, 2]
    radii = image_radii(refined, np.hstack([table.primary, table.secondary]))
    return ModelCheck(
        matching=_overall(IN_IMAGES, in_images, figures.mean_reprojection_px),
        measuring=_overall(IN_LENGTH, in_length, figures.mean_error_3d),
        places=(
            *held_out.by_halves(PLACES[:2], depths, draws.depths),
            *held_out.by_halves(PLACES[2:], radii, draws.radii),
        ),
        notes=tuple(notes_on_noise(model, innovations)),
    )


def _overall(what: str, ratio: _Ratio, forecast: Estimate) -> HeldOutRatio:
    """The errors of all frames, with the standard error of the forecast beside their own."""
    # The interval holds 95 %, so its logarithm is 2 x 1.96 standard errors wide.
    sigma = float(np.log(forecast.high / forecast.low)) / (2 * 1.96)
    excess = float(np.log(ratio.value) / np.hypot(ratio.spread, sigma))
    return HeldOutRatio("", what, ratio.value, excess)


def _held_out_errors(
    data: Pair, clusters: IntArray, whole: RefinedResult
) -> tuple[FloatArray, FloatArray] | None:
    """Reprojection errors (n,) of the pairs and length errors (m,) of the bars, each held out with
    all frames of its cluster (f,), from fits that begin where that to all frames ended."""
    table = data.correspondences
    if len(table.frames) < MINIMUM_FRAMES:
        return None
    order = np.random.default_rng([0, 0xF01D]).permutation(clusters.max() + 1) % FOLDS
    part = order[clusters][np.searchsorted(table.frames, table.frame)]
    px, lengths = np.empty(len(table)), np.empty(len(table.bars))
    for fold in range(FOLDS):
        try:
            fit = refine(data, whole.settings, whole.pose, part != fold, near=whole)
        except StereocalError:
            return None
        errors = errors_of(fit.apply(data), fit.pose)
        px[part == fold] = errors.reprojection_px[part == fold]
        of_bars = part[table.bars[:, 0]] == fold
        lengths[of_bars] = errors.length[of_bars]
    return px, lengths


def _ratio(errors: FloatArray, forecast: float, clusters: IntArray) -> _Ratio:
    """Mean of errors (n,) over the forecast one, and the standard error of its logarithm; NaN if
    they are few. The sums of the errors are independent between the clusters (n,).
    """
    is_known = np.isfinite(errors)
    known, cluster = errors[is_known], np.unique(clusters[is_known], return_inverse=True)[1]
    count = int(cluster.max(initial=-1)) + 1
    if count < MINIMUM_ERRORS:
        return _Ratio(float("nan"), float("nan"))
    mean = float(known.mean())
    sums = np.bincount(cluster, known - mean)
    variance = float(np.sum(np.square(sums))) * count / (count - 1)
    return _Ratio(mean / forecast, variance**0.5 / mean / len(known))


def cause_of_scatter(model: RefinedResult, bars: Innovations) -> str:
    """Why the lengths of bars vary more than the noise explains, by the likelihoods of two causes;
    empty if they do not. A bar that bends varies alike everywhere; noise along the epipolar lines
    makes those lengths vary most that are least certain."""
    known = np.isfinite(bars.errors_m)
    smallest = SMALLEST_SCATTER * model.dataset.target_distance_m
    if model.scatter_m.source != ESTIMATED or not model.scatter_m.value > 2 * smallest:
        return ""
    v, squares = bars.variances_m2[known], np.square(bars.errors_m[known])

    def best(variances: FloatArray) -> float:
        """The largest log-likelihood of rows of variances."""
        return float(np.max(-0.5 * (np.log(variances) + squares / variances).sum(axis=1)))

    added = best(v + np.square(model.scatter_m.value * FACTORS[:, None]))
    multiplied = best(v * np.square(1 + FACTORS[:, None]))
    if abs(added - multiplied) < TELLING:
        return UNCLEAR
    return BENDS if added > multiplied else ALONG


def notes_on_noise(model: RefinedResult, bars: Innovations) -> list[str]:
    """What is unusual about the noise, for the user."""
    notes = []
    if cause := cause_of_scatter(model, bars):
        notes.append(
            f"The lengths of the bar vary by {rounded(1000 * model.scatter_m.value)} mm more than "
            f"the noise of the images explains: {cause}."
        )
    if exceeds_detection(model):
        notes.append(
            f"The points scatter by {rounded(model.sigma_px.value)} px, detection states "
            f"{rounded(_stated_noise(model))} px: the rest is what the model lacks (distortion, "
            "vibration, cameras out of step)."
        )
    return notes


def exceeds_detection(model: RefinedResult) -> bool:
    """Whether points scatter more than their detection states."""
    return model.sigma_px.source == ESTIMATED and (
        model.sigma_px.value > NOISE_EXCESS * _stated_noise(model)
    )


def _stated_noise(model: RefinedResult) -> float:
    """Root mean square of what the detection of the points states, px; NaN if it states nothing."""
    table, rows = model.dataset.correspondences, model.used_rows
    sigmas = np.concatenate([table.sigma_primary_px[rows], table.sigma_secondary_px[rows]])
    return float(np.sqrt(np.nanmean(np.square(sigmas)))) if np.isfinite(sigmas).any() else np.nan
