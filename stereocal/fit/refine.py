"""Method 4, refined: one parameter set to match and to measure, by one weighted least squares.

The adjustment (`adjustment`) combines pixel residuals over their noise, bar-length residuals over
their scatter, and priors on the measured baseline, the measured bar and both lenses. The 3D points
of the targets are eliminated. A bar that is far away or along the line of sight therefore gets
little weight, because the images determine its length poorly.

Frames with gross errors are detected and left out (`solve`); the covariance is that of the least
squares over the other frames.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.noise import Noise
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import rig_of
from stereocal.fit.least_squares.unknowns import (
    RefineSettings,
    RigMarginal,
    Unknowns,
    baseline_sigma_m,
    distance_sigma_m,
    inverse_of,
    settings_for,
)
from stereocal.fit.least_squares.views import EACH, LENS, TRANSLATION
from stereocal.fit.refined_result import RefinedResult
from stereocal.fit.start.behind_windows import begins_behind_windows
from stereocal.fit.start.first_poses import first_poses
from stereocal.rig.compiled import clock
from stereocal.rig.geometry import AT_ORIGIN, Pose
from stereocal.rig.pair import Pair
from stereocal.system.array_types import BoolArray, FloatArray
from stereocal.system.numbers import rounded

OUT_OF_STEPS = "the largest number of steps was reached"
MAXIMUM_NOISE_PX = 30.0
"""A fit with more noise is rejected: the points do not belong together."""
LARGEST_FACTOR, MOST_SIGMAS = 1.5, 10.0
"""By what factor, or by how many of its standard errors, a fit may change a measured length. Wrong
lenses change lengths by percents; the screening's wide priors may explain a wrong unit of one."""
ENOUGH_BEHIND_WINDOWS = 2
"""Fits of which one without outlying frames is enough."""

OF_T = slice(EACH + TRANSLATION, EACH + LENS)
"""The places of T of the secondary camera."""


def refine(
    dataset: Pair,
    settings: RefineSettings | None = None,
    start: Pose | None = None,
    rows: BoolArray | None = None,
    near: RefinedResult | None = None,
) -> RefinedResult:
    """Compute the refined set of a data set.

    Args:
        start: initial pose, such as that of the essential method; computed if None. If the fit
            from there has outlying frames, or others may fit elsewhere, they are tried too.
        rows: mask (n,) of the rows to fit; all if None.
        near: a fit of nearly the same rows with the same settings, from which to start first.

    The time offset is an unknown only where the motion of the points is known, after
    `Pair.shifted` (see `time_offset.bring_into_step`).
    """
    settings = settings_for(dataset.recording, settings or RefineSettings())
    if settings.of_rig is not None:
        return _of_rig(dataset, settings, settings.of_rig, rows)
    started = clock()
    best: RobustFit | None = None
    tried = list[RobustFit]()
    for solve, is_only in _solves(dataset, settings, start, rows, near):
        if solve.run(tried) and (best is None or solve.better_than(best)):
            best = solve
        tried.append(solve)
        if best is not None and not best.outlying.any() and is_only:
            break
    if best is None or best.sigma_px > MAXIMUM_NOISE_PX:
        raise StereocalError(
            "The refined method found no pose of the cameras that fits: check that points, "
            "targets and camera files are not exchanged."
        )
    unknowns, p = _with_baseline(best, dataset)
    result = _result(best, dataset, rows, unknowns, p, clock() - started)
    if not result.unknowns.determined(result.information):
        raise StereocalError(
            "The points do not determine the refined set: record more bars, at other places and in "
            "other directions."
        )
    _check_lengths(result)
    return result


def fit_from(
    dataset: Pair, start: Pose, settings: RefineSettings, rows: BoolArray | None = None
) -> RobustFit:
    """The fit of a pair from an initial pose, of all rows or of those of a mask (n,)."""
    poses = AT_ORIGIN, start
    return RobustFit.of(dataset.recording, poses, settings, dataset.of_both(rows))


def _result(
    fit: RobustFit,
    dataset: Pair,
    rows: BoolArray | None,
    unknowns: Unknowns,
    p: FloatArray,
    seconds: float,
) -> RefinedResult:
    """The result of a fit at its end, with these unknowns of it."""
    rig = rig_of(dataset.primary, dataset.secondary, fit.at)
    seen = np.isfinite(fit.seen.pixels[:, :, 0, :1])
    return RefinedResult(
        dataset=dataset,
        settings=fit.settings,
        pose=rig.pose,
        primary=rig.primary,
        secondary=rig.secondary,
        rows=rows,
        unknowns=unknowns,
        p=p,
        information=fit.H,
        sigma_px=Noise(fit.sigma_px, fit.source_px),
        scatter_m=Noise(fit.scatter, fit.source_scatter),
        frames=fit.frames,
        chi_squares=fit.chi_squares,
        degrees_of_freedom=fit.degrees_of_freedom,
        outlying=fit.outlying,
        frame_of=fit.frame_of,
        points_m=np.where(seen, fit.points.reshape(-1, 2, 3), np.nan),
        cost=float(fit.cost),
        steps=fit.steps,
        stop_reason="converged" if fit.converged else OUT_OF_STEPS,
        seconds=seconds,
    )


def _of_rig(
    dataset: Pair, settings: RefineSettings, known: RigMarginal, rows: BoolArray | None
) -> RefinedResult:
    """The refined set of two cameras of a rig: the rig's.

    With some of the rows only, what the pair's images of the others said is taken out of it, to
    first order.
    """
    fit = fit_from(dataset, known.pose, settings, rows)
    M, to_free = fit.unknowns.M, np.linalg.pinv(fit.unknowns.M)
    A = inverse_of(to_free @ np.array(known.covariance) @ to_free.T)
    values = to_free @ (np.array(known.q) - fit.unknowns.origin)
    fit.take(values, fit.sigma_px, fit.scatter)
    if rows is not None and not rows.all():
        seen = Observations.of(dataset.recording, False, dataset.of_both(~rows))
        others = RobustFit(seen, fit.unknowns, settings, fit.begin.R, fit.baselines)
        others.take(values, fit.sigma_px, fit.scatter)
        H, g, _ = others.equations([np.arange(len(others.frames))])
        A = A - M.T @ H[0] @ M / known.design_effect
        fit.p = values + inverse_of(A) @ (M.T @ g[0]) / known.design_effect
    fit.evaluate(np.full(len(fit.frames), np.inf))
    fit.cost, fit.converged = float(fit.chi_squares.sum()), True
    precision = A - M.T @ fit.H @ M / known.design_effect
    # What was found is where the rig's information is: nothing pulls it elsewhere.
    origin = fit.at.q
    unknowns = replace(fit.unknowns, origin=origin, precision=precision)
    return _result(fit, dataset, rows, unknowns, np.zeros(len(values)), 0.0)


def _with_baseline(fit: RobustFit, dataset: Pair) -> tuple[Unknowns, FloatArray]:
    """The unknowns and the free parameters of a fit about a T of the measured length: the measured
    baseline is a prior of it, linear along T."""
    unknowns, p, T = fit.at_end, fit.p.copy(), fit.at.q[OF_T]
    free_T, stated, origin = unknowns.M[OF_T].any(axis=0), T, unknowns.origin.copy()
    if len(fit.baselines):
        stated = T * (dataset.baseline_m / np.linalg.norm(T))
    origin[OF_T], p[free_T] = stated, T - stated
    return replace(unknowns, origin=origin), p


def _check_lengths(result: RefinedResult) -> None:
    """Check that the fit has kept to the measured lengths."""
    settings, dataset = result.settings, result.dataset
    baseline, bar = dataset.baseline_m, dataset.target_distance_m
    factors = result.pose.baseline / baseline, result.bar_factor
    sigmas = baseline_sigma_m(dataset, settings), distance_sigma_m(dataset.recording, settings)
    whats = "baseline", "distance between the targets"
    for what, factor, sigma, stated in zip(whats, factors, sigmas, (baseline, bar), strict=True):
        most = max(LARGEST_FACTOR, 1.0 + MOST_SIGMAS * sigma / stated)
        if np.isinf(sigma) or 1.0 / most < factor < most:
            continue
        raise StereocalError(
            f"The refined method would change the {what} from {stated:g} to "
            f"{rounded(factor * stated, 3)} "
            "m: check both lengths and their uncertainties, in metres, and both camera files."
        )


def _solves(
    dataset: Pair,
    settings: RefineSettings,
    start: Pose | None,
    rows: BoolArray | None,
    near: RefinedResult | None,
) -> Iterator[tuple[RobustFit, bool]]:
    """Solves from several initial values, and whether one without outlying frames is enough by
    then: the others begin nearly where one before did."""
    if near is not None:
        solve, noise = fit_from(dataset, near.pose, settings, rows), near.sigma_px.value
        ended = near.unknowns.named(near.p)
        if solve.unknowns.names == near.unknowns.names and solve.start_near(
            ended, noise, near.scatter_m.value
        ):
            yield solve, True
    rays = dataset.rays if rows is None else np.ascontiguousarray(dataset.rays[:, rows])
    if dataset.recording.windows:
        begins = begins_behind_windows(dataset, rays, settings.loss == "robust")
        for number, (pose, known) in enumerate(begins, 1):
            solve = fit_from(dataset, pose, settings, rows)
            solve.start_at(known, solve.sigma_px)
            yield solve, number >= ENOUGH_BEHIND_WINDOWS
        return
    apart, alike = first_poses(dataset, start, rays, settings.loss == "robust")
    for number, pose in enumerate(apart + alike, 1):
        yield fit_from(dataset, pose, settings, rows), number >= len(apart)
