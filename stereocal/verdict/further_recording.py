"""How much the figures of a file differ on a further recording whose frames follow each other.

A further recording has other places, and other noise where blur or detection change. How much that
matters shows between runs of the recording at hand: the variance of the logarithm of a figure
between ten of them, beyond that of as many groups of frames drawn at random. A further recording in
the same volume, a third as long as this one, differs by so much from the forecast, and by what its
finite number of frames makes. Frames follow each other where their errors are alike, or where their
bars lie close together.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from stereocal.calibration.methods import Method
from stereocal.calibration.results import errors_of
from stereocal.evaluation.summary import Estimate
from stereocal.refined.refine import RefinedResult
from stereocal.rig.clusters import clusters_of
from stereocal.rig.compiled import FloatArray
from stereocal.rig.rig import Rig

RUNS = 10
FEWEST = 4
"""Frames of a run, and runs."""
SHUFFLES = 60
LENGTH = 1 / 3
"""Of a further recording, over that of the one at hand."""
LARGEST = float(np.log(3.0))
"""Half width in logarithms: few frames show runs that differ by far more than recordings do."""


@dataclass(frozen=True)
class Further:
    """Half widths of 95 % intervals in logarithms, for what differs between recordings."""

    in_images: float = 0.0
    mean_length: float = 0.0
    median_length: float = 0.0
    p95_length: float = 0.0

    def of(self, figure: str) -> float:
        """That of a figure of a forecast. Thresholds and shares follow the errors in the images."""
        return {
            "mean_error_3d": self.mean_length,
            "median_error_3d": self.median_length,
            "p95_error_3d": self.p95_length,
        }.get(figure, self.in_images)


def further_recordings(
    model: RefinedResult, files: Mapping[Method, Rig], seed: int = 0
) -> dict[Method, Further]:
    """Of each file how its figures differ on a further recording; empty for single frames.

    Args:
        model: the fit whose frames are compared.
        files: the sets that were written, of the same data set.
        seed: of the groups of frames drawn at random.
    """
    table = model.dataset.correspondences
    if not (model.clusters.has_runs or _moves(model)):
        return {}
    order = np.argsort(table.time_frame, kind="stable")
    used = order[model.used_rows[order]]
    bars = np.flatnonzero(model.used_rows[table.bars].all(axis=1))
    bars = bars[np.argsort(table.time_frame[table.bars[bars, 0]])]
    found: dict[Method, Further] = {}
    for method, rig in files.items():
        rng = np.random.default_rng([seed, 0xF127])
        seen = replace(model.dataset, primary=rig.primary, secondary=rig.secondary)
        errors = errors_of(seen, rig.pose)
        at = np.unique(table.time_frame[used], return_inverse=True)[1]
        px = np.bincount(at, errors.reprojection_px[used]) / np.bincount(at)
        length = errors.length[bars]
        found[method] = Further(
            half_width(px, _mean, rng),
            half_width(length, _mean, rng),
            half_width(length, _median, rng),
            half_width(length, _p95, rng),
        )
    return found


def _moves(model: RefinedResult) -> bool:
    """Whether bars lie closer to those of neighbouring frames than to others."""
    table, frames = model.dataset.correspondences, model.frames[~model.outlying]
    first = np.unique(table.frame, return_index=True)
    times = table.time_frame[first[1][np.searchsorted(first[0], frames)]]
    middles = model.points_m[~model.outlying].mean(axis=1)
    places = np.column_stack([middles[:, :2] / middles[:, 2:], np.log(middles[:, 2])])
    order = np.argsort(times)
    return clusters_of(times[order], (places - np.nanmean(places, axis=0))[order]).length > 1


def half_width(
    errors: FloatArray, figure: Callable[[FloatArray], FloatArray], rng: np.random.Generator
) -> float:
    """Half width of the interval of a figure of the errors (f,), which are in the order of time."""
    known = errors[np.isfinite(errors)]
    runs = min(RUNS, len(known) // FEWEST)
    if runs < FEWEST:
        return 0.0
    known = known[: len(known) // runs * runs]

    def between(values: FloatArray) -> FloatArray:
        """(...): variance between the runs of (..., f)."""
        parts = figure(values.reshape(*values.shape[:-1], runs, -1))
        return np.asarray(np.log(np.maximum(parts, 1e-300)).var(axis=-1, ddof=1))

    shuffled = rng.permuted(np.broadcast_to(known, (SHUFFLES, len(known))), axis=1)
    of_frames = float(between(shuffled).mean())
    excess = max(float(between(known)) - of_frames, 0.0)
    recordings = 1 / (runs * LENGTH)
    squares = stdtrit(runs - 1, 0.975) ** 2 * excess * (recordings + 1 / runs)
    return min(float(np.sqrt(squares + 1.96**2 * of_frames * recordings)), LARGEST)


def widened(estimate: Estimate, half: float) -> Estimate:
    """An interval with a further half width in logarithms, added in quadrature on either side."""
    if not half or not estimate.value > 0:
        return estimate
    value = estimate.value
    down = math.log(value / estimate.low) if estimate.low > 0 else math.inf
    return replace(
        estimate,
        low=value * math.exp(-math.hypot(down, half)),
        high=value * math.exp(math.hypot(math.log(estimate.high / value), half)),
    )


def _mean(errors: FloatArray) -> FloatArray:
    return np.asarray(errors.mean(axis=-1))


def _median(errors: FloatArray) -> FloatArray:
    return np.asarray(np.median(errors, axis=-1))


def _p95(errors: FloatArray) -> FloatArray:
    return np.asarray(np.percentile(errors, 95, axis=-1))
