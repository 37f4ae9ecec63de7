"""Rigs drawn from a plan: a recording simulated and calibrated on each, its files judged.

The true focal lengths, principal points, baseline and bar differ from the stated ones by normal
errors of the plan's uncertainties (a scrambled Sobol sequence, which needs fewer rigs than random
numbers). The recording is calibrated as stated, and all files are judged on fresh bars, seen by the
true cameras. Length errors are relative to true lengths. (Those of a recording are relative to a
bar measured as its own was, because nothing else is known there.)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats.qmc import Sobol

from stereocal.calibration.methods import FILE_METHODS, CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.evaluation import counting
from stereocal.evaluation.evaluate import paper_angles
from stereocal.evaluation.summary import crossing, merge_bins, overlap
from stereocal.field.planning.bars import place_planned_bars
from stereocal.field.planning.expected import plan_settings, planned_dataset
from stereocal.field.planning.plan import Plan
from stereocal.fit.least_squares.small_steps import (
    FACTOR,
    pose_at,
    pose_places,
    rig_at,
    undistort_rays,
)
from stereocal.fit.least_squares.views import EACH, LENS, TRANSLATION, Cameras
from stereocal.fit.refine import refine
from stereocal.rig.geometry import Angles, Pose, triangulate_rays
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.verdict.forecast_draws import partners_in_groups
from stereocal.verdict.intervals import MERGE
from stereocal.verdict.judging import judge, photograph

FIGURES = (
    "mean_length_error",
    "median_error_3d",
    "p95_error_3d",
    "fcp_reprojection",
    "threshold_px",
    "mean_reprojection_px",
    "wrong_let_in_at_threshold",
)
TEST_BARS = 200
WRONG_PARTNERS = 9
REFINED_EVERY = 2
"""The refined set takes half of the time, and its errors differ least from rig to rig: it is
computed on every second rig."""
SPARE = 1.3
"""Bars in reserve, because a wrong lens moves some out of an image."""


@dataclass(frozen=True, eq=False)
class DrawnRigs:
    """The figures of drawn rigs; NaN where a calibration failed, and of the refined set in the rigs
    on which it is not computed.
    """

    figures: FloatArray
    """(rigs, files, figures): `FILE_METHODS`, `FIGURES`."""
    position_m: FloatArray
    """(rigs,): mean distance of reconstructed from true points, of the refined set."""
    length_errors: FloatArray
    """(rigs, files, TEST_BARS): relative errors of true lengths."""

    @property
    def count(self) -> int:
        return len(self.position_m)

    @property
    def failed(self) -> int:
        """The number of rigs whose recording could not be calibrated."""
        return int(np.isnan(self.figures[:, 0, 0]).sum())


def draw_rigs(plan: Plan, seed: int, first: int, end: int) -> DrawnRigs:
    """The figures of the rigs from `first` to before `end` of the sequence of a seed."""
    # Standard normal errors of the two focal lengths, centres, baseline and bar.
    sequence = Sobol(8, scramble=True, rng=np.random.default_rng([seed, 8]))
    uniform = sequence.random_base2(int(np.ceil(np.log2(max(end, 2)))))[first:end]
    errors = ndtri(np.clip(uniform, 1e-6, 1 - 1e-6))
    rng = np.random.default_rng([seed, first])
    needed = plan.frames + TEST_BARS
    bars = place_planned_bars(plan, int(SPARE * needed) + (len(errors) - 1) * plan.frames, rng)
    figures = np.full((len(errors), len(FILE_METHODS), len(FIGURES)), np.nan)
    position = np.full(len(errors), np.nan)
    lengths = np.full((len(errors), len(FILE_METHODS), TEST_BARS), np.nan)
    partners = partners_in_groups(TEST_BARS, rng, WRONG_PARTNERS)
    sigma, stated = plan.uncertainty, rig_at(plan.rig)
    for k, error in enumerate(errors):
        truth = stated._replace(q=stated.q.copy())
        for camera, of_lens in enumerate((LENS, EACH + LENS)):
            truth.q[of_lens : of_lens + 2] *= 1.0 + sigma.focal * error[camera]
            off = error[2 + 2 * camera : 4 + 2 * camera]
            truth.q[of_lens + 2 : of_lens + 4] += sigma.centre_px * off
        truth.q[pose_places(1)][TRANSLATION:] *= 1.0 + sigma.baseline_m / plan.baseline_m * error[6]
        truth.q[FACTOR] += sigma.bar_m / plan.bar_m * error[7]
        shuffled = bars[rng.permutation(len(bars))[: int(SPARE**2 * needed)]]
        try:
            refined = (first + k) % REFINED_EVERY == 0
            judged, off, position[k] = _one_rig(plan, truth, shuffled, partners, rng, refined)
            figures[k, : len(judged)], lengths[k, : len(judged)] = judged, off
        except StereocalError:
            continue
    return DrawnRigs(figures, position, lengths)


def _one_rig(
    plan: Plan,
    truth: Cameras,
    bars: FloatArray,
    partners: IntArray,
    rng: np.random.Generator,
    refined: bool,
) -> tuple[FloatArray, FloatArray, float]:
    """(files, figures), the length errors (files, TEST_BARS), and the position error of the refined
    set in metres; without it, those of the other two files, and NaN.

    `truth` has the true length of the bar over the stated.
    """
    middle = bars.mean(axis=1, keepdims=True)
    ends = middle + truth.q[FACTOR] * (bars - middle)
    pixels = np.empty((2 * len(ends), 4))
    photograph(truth, np.ascontiguousarray(ends.reshape(-1, 3)), pixels)
    pixels += plan.noise_px * rng.standard_normal(pixels.shape)
    sizes = np.array([*plan.primary.image_size, *plan.secondary.image_size])
    inside = ((pixels > -0.5) & (pixels < sizes - 0.5)).all(axis=1).reshape(-1, 2).all(axis=1)
    kept = np.flatnonzero(inside)
    if len(kept) < plan.frames + TEST_BARS:
        raise StereocalError("Too many bars are out of view.")
    recorded, tested = kept[: plan.frames], kept[plan.frames :][:TEST_BARS]
    seen, tests = (pixels.reshape(-1, 2, 4)[bars].reshape(-1, 4) for bars in (recorded, tested))
    dataset = planned_dataset(plan, seen)
    seeds = np.random.SeedSequence(int(rng.integers(2**63))).spawn(2)
    everything = np.ones(len(seen), dtype=np.bool_)
    angles = paper_angles(dataset, everything, CalibrationSettings(), *seeds)
    poses = [Pose.from_angles(Angles(*row.tolist()), plan.baseline_m) for row in angles]
    sets = [rig_at(Rig(plan.primary, plan.secondary, pose)) for pose in poses[1:]]
    if refined:
        cameras = refine(dataset, plan_settings(plan), poses[0]).at
        sets.append(cameras._replace(q=np.append(cameras.q[:FACTOR], 1.0)))
    return _judged(sets, truth, ends[tested], tests, partners)


def _judged(
    sets: Sequence[Cameras],
    truth: Cameras,
    ends: FloatArray,
    pixels: FloatArray,
    partners: IntArray,
) -> tuple[FloatArray, FloatArray, float]:
    points = np.ascontiguousarray(ends.reshape(-1, 3))
    seen = pose_at(truth).apply(points)
    start = np.column_stack([points[:, :2] / points[:, 2:], seen[:, :2] / seen[:, 2:]])
    rays = np.ascontiguousarray(start.T)
    distances = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1)
    counts, lengths, correct_px = judge(sets, pixels, rays, distances, partners)
    of_px = counts[:, counting.REPROJECTION].astype(np.int64)
    limits, wrong = crossing(of_px), of_px[:, 1 - counting.CORRECT]
    inside = np.arange(wrong.shape[1])[None] < limits[:, None]
    below = wrong[:, counting.UNDERFLOW] + np.where(inside, wrong, 0).sum(axis=1)
    errors = np.abs(lengths - 1.0)
    quantiles = np.percentile if np.isfinite(errors).all() else np.nanpercentile  # 20 times faster
    figures = np.column_stack(
        [
            np.nanmean(errors, axis=1),
            *quantiles(errors, (50, 95), axis=1),
            overlap(merge_bins(of_px, MERGE)),
            10.0 ** (counting.LOWEST + counting.BIN_WIDTH * limits),
            correct_px,
            below / wrong.sum(axis=1),
        ]
    )
    if len(sets) < len(FILE_METHODS):
        return figures, errors, float("nan")
    refined = sets[FILE_METHODS.index("refined")]
    undistort_rays(refined.q, refined.lenses, pixels, rays)
    pose = pose_at(refined)
    away = np.linalg.norm(triangulate_rays(pose.R, pose.T, rays) - points, axis=1)
    return figures, errors, float(np.nanmean(away))
