"""The figures of parameter files on a large test whose truth is known."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stereocal.calibration.methods import ALL_METHODS, Method
from stereocal.evaluation.compiled_run import BINS, CORRECT, REPROJECTION, RESIDUAL, UNDERFLOW
from stereocal.evaluation.summary import merge_bins, overlap
from stereocal.refined.solve import lenses_of_cameras
from stereocal.refined.unknowns import shared_unknowns
from stereocal.rig.compiled import FloatArray
from stereocal.rig.rig import Rig
from stereocal.verdict.fresh_bars import GROUP
from stereocal.verdict.intervals import MERGE
from stereocal.verdict.judging import judge
from stereocal.verdict.predictive import bin_edge, partners_in_groups


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
        pixels,
        np.ascontiguousarray(start.T),
        np.linalg.norm(ends_m[:, 0] - ends_m[:, 1], axis=1) / bar_factor,
        partners_in_groups(bars, rng, 2 * GROUP - 1),
        counts,
        nans,
        lengths,
        correct_px,
    )
    found = {}
    for at, method in enumerate(methods):
        merged = overlap(merge_bins(counts[at].astype(np.int64), MERGE))
        limit = bin_edge(thresholds[method])
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
