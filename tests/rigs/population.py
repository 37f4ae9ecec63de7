"""The figures of parameter files on a large test whose truth is known, of rigs and of plans."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from stereocal.calibration.methods import ALL_METHODS, FILE_METHODS, CalibrationSettings, Method
from stereocal.errors import StereocalError
from stereocal.evaluation.counting import CORRECT, REPROJECTION, RESIDUAL, UNDERFLOW
from stereocal.evaluation.evaluate import count_set
from stereocal.evaluation.summary import merge_bins, overlap
from stereocal.field.planning.plan import Plan
from stereocal.fit.least_squares.small_steps import rig_at
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.library.calibrations import calibrate
from stereocal.rig.geometry import Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Nominal, observe, place_bars
from stereocal.system.array_types import FloatArray
from stereocal.verdict.forecast import forecast_files
from stereocal.verdict.forecast_draws import ForecastFigures, bin_of_threshold, partners_in_groups
from stereocal.verdict.fresh_frames import GROUP
from stereocal.verdict.intervals import MERGE
from stereocal.verdict.judging import judge
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M, Misjudged, misjudged, random_scene, stated


def population(
    truth: Rig,
    files: Mapping[Method, Rig],
    ends_m: FloatArray,
    noise_px: float,
    thresholds: Mapping[Method, float],
    rng: np.random.Generator,
    bar_factor: float = 1.0,
) -> dict[Method, dict[str, float]]:
    """The figures of files on a large test whose truth is known, named as in `ForecastFigures`.

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
    counts, lengths, correct_px = judge(
        [rig_at(files[method]) for method in methods],
        pixels,
        np.ascontiguousarray(start.T),
        np.linalg.norm(ends_m[:, 0] - ends_m[:, 1], axis=1) / bar_factor,
        partners_in_groups(bars, rng, 2 * GROUP - 1),
    )
    found = {}
    for at, method in enumerate(methods):
        merged = overlap(merge_bins(counts[at].astype(np.int64), MERGE))
        limit = bin_of_threshold(thresholds[method])
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


def figures_on(data: Pair, rig: Rig) -> dict[str, float]:
    """Of one file on a data set."""
    seen = data.changed(primary=rig.primary, secondary=rig.secondary)
    run = count_set(seen, rig.pose)
    errors = np.abs(run.lengths[0] - 1.0)
    fcp = overlap(merge_bins(run.counts[0, 1].astype(np.int64), MERGE))
    return {
        "fcp_reprojection": float(fcp),
        "mean_reprojection_px": float(run.correct_px[0]),
        "median_error_3d": float(np.nanmedian(errors)),
        "p95_error_3d": float(np.nanpercentile(errors, 95)),
    }


CASES: Mapping[str, Misjudged] = {
    "exact": Misjudged(0.0, 0.0, 0.0, 0.0),
    "0.2 %, 4 px, baseline 0.5 %": Misjudged(0.0115, 0.0005, 0.002, 4.0),
    "1 %, 15 px, baseline 2 %": Misjudged(0.046, 0.0005, 0.01, 15.0),
}


NOISE_PX = (0.1, 0.5)
TEST_BARS = 2000
FIGURES = (
    "fcp_residual",
    "fcp_reprojection",
    "correct_lost_at_threshold",
    "wrong_let_in_at_threshold",
    "mean_reprojection_px",
    "median_error_3d",
    "p95_error_3d",
)


def one_rig(off: Misjudged, frames: int, seed: int) -> dict[Method, dict[str, tuple[float, ...]]]:
    """Of each file and figure: the population's value, and value, low, high of the forecast."""
    rng = np.random.default_rng([seed, frames, int(1e6 * off.focal)])
    noise = float(np.exp(rng.uniform(*np.log(NOISE_PX))))
    scene = random_scene(rng, frames)
    dataset = stated(scene, rng, replace(off, noise_px=noise))
    settings = off.settings() if off.focal else RefineSettings()
    calibration = calibrate(dataset, CalibrationSettings(), refined=settings)
    forecast = forecast_files(calibration)
    files, figures = forecast.files, forecast.draws.figures
    factor = BAR_M / dataset.target_distance_m
    test = place_bars(scene.rig, rng, TEST_BARS, BAR_M, DEPTHS_M)
    thresholds = {method: found.threshold_px.value for method, found in figures.items()}
    truths = population(scene.rig, files, test.ends_m, noise, thresholds, rng, factor)
    return {
        method: {
            figure: (truths[method][figure], *_numbers(figures[method], figure))
            for figure in FIGURES
        }
        for method in figures
    }


def _numbers(figures: ForecastFigures, figure: str) -> tuple[float, float, float]:
    estimate = getattr(figures, figure)
    return estimate.value, estimate.low, estimate.high


FIGURES_OF_PLANS = {
    name: name
    for name in ("median_error_3d", "p95_error_3d", "fcp_reprojection", "mean_reprojection_px")
} | {"mean_length_error": "mean_error_3d"}
"""Their names in `population`."""


def observed(plan: Plan, seed: int) -> dict[tuple[Method, str], float]:
    """The figures of the files of one field day on its population."""
    rng = np.random.default_rng([seed, 0xF1E1D])
    own = plan.uncertainty
    off = Misjudged(own.baseline_m, own.bar_m, own.focal, own.centre_px, plan.noise_px)
    planned, depths = Rig(plan.primary, plan.secondary, plan.pose), (plan.near_m, plan.far_m)
    nominal = Nominal(plan.primary, plan.secondary, plan.baseline_m, plan.bar_m)
    true = misjudged(planned, plan.bar_m, rng, off)
    pose = Pose(plan.pose.R, plan.pose.T * true.baseline_m / plan.baseline_m)
    truth, bar = Rig(true.primary, true.secondary, pose), true.target_distance_m
    scene = place_bars(truth, rng, plan.frames, bar, depths)
    dataset = observe(scene, rng, plan.noise_px, plan.name, nominal)
    found = calibrate(dataset, refined=off.settings())
    files = {m: Rig(plan.primary, plan.secondary, r.pose) for m, r in found.methods.items()}
    refined = found.refined
    if refined is None:
        raise StereocalError("There is no refined set.")
    files["refined"] = refined.rig
    test = place_bars(truth, rng, TEST_BARS // 2, bar, depths)
    limits: dict[Method, float] = dict.fromkeys(files, 1.0)
    figures = population(truth, files, test.ends_m, plan.noise_px, limits, rng)
    return {
        (method, name): figures[method][known]
        for method in FILE_METHODS
        for name, known in FIGURES_OF_PLANS.items()
    }
