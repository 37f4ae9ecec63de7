"""Method 4, refined: one parameter set to match and to measure, by one weighted least squares.

The adjustment (`adjustment`) combines pixel residuals over their noise, bar-length residuals over
their scatter, and priors on the measured baseline, the measured bar and both lenses. The 3D points
of the targets are eliminated. A bar that is far away or along the line of sight therefore gets
little weight, because the images determine its length poorly.

Frames with gross errors are detected and left out (`solve`); the covariance is that of the least
squares over the other frames.
"""

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from stereocal.calibration.essential import calibrate_essential, choose_pose
from stereocal.errors import StereocalError
from stereocal.fit.least_squares.design_effect import (
    FEWEST,
    clusters_in,
    covariance_of_boards,
    design_effect,
    lenses_without,
)
from stereocal.fit.least_squares.noise import Noise
from stereocal.fit.least_squares.observations import Observations
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import FACTOR, cameras_at, rig_of
from stereocal.fit.least_squares.unknowns import (
    RefineSettings,
    RigMarginal,
    Unknowns,
    baseline_sigma_m,
    distance_sigma_m,
    inverse_of,
    settings_for,
)
from stereocal.fit.least_squares.views import DRIFT, EACH, LENS, TIME, TRANSLATION, Cameras
from stereocal.rig.camera import Camera
from stereocal.rig.clusters import Clusters, in_equal_runs
from stereocal.rig.compiled import clock
from stereocal.rig.geometry import AT_ORIGIN, Pose, residuals, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import MeasuredOffset, TimeOffset
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.system.numbers import rounded

OUT_OF_STEPS = "the largest number of steps was reached"
MAXIMUM_NOISE_PX = 30.0
"""A fit with more noise is rejected: the points do not belong together."""
ALIKE = 0.9
"""Cosine of the angle between the baselines of first poses from which on one of them is enough."""
PLAUSIBLE = 3.0
"""Median residuals from which on a pose with depths reversed is not tried."""
LARGEST_FACTOR, MOST_SIGMAS = 1.5, 10.0
"""By what factor, or by how many of its standard errors, a fit may change a measured length. Wrong
lenses change lengths by percents; the screening's wide priors may explain a wrong unit of one."""


OF_T = slice(EACH + TRANSLATION, EACH + LENS)
"""The places of T of the secondary camera."""


@dataclass(frozen=True, eq=False)
class RefinedResult:
    """The refined set: pose and lenses with their covariance, and the fit of each frame."""

    dataset: Pair
    settings: RefineSettings
    pose: Pose
    primary: Camera
    secondary: Camera
    rows: BoolArray | None
    """(n,): mask of the rows that were fitted; None for all."""
    unknowns: Unknowns
    """With the measured baseline among the priors of T."""
    p: FloatArray
    """(k,): the estimated free parameters, as deviations from `unknowns.origin`."""
    information: FloatArray
    """(Q, Q): information matrix of the unknowns of `views` from images and lengths, without the
    priors."""
    sigma_px: Noise
    """Standard deviation of an image coordinate."""
    scatter_m: Noise
    """Standard deviation of the bar's length from frame to frame."""
    frames: IntArray
    """(f,): the frame numbers."""
    chi_squares: FloatArray
    """(f,): chi-square of each frame; infinite behind a camera."""
    degrees_of_freedom: IntArray
    """(f,): 3 for a frame with a bar, 1 for a single target; the sum of the parts of an object."""
    outlying: BoolArray
    """(f,): true for the frames that were left out."""
    frame_of: IntArray
    """(u,): index into `frames` of each part of a frame (`Correspondences.parts`), ascending."""
    points_m: FloatArray
    """(u, 2, 3): adjusted 3D points of A and B in the primary's frame, of an object those of each
    part; NaN if not seen."""
    cost: float
    """Sum of the chi-squares of the frames used and of the priors; of a pair of a rig, which has no
    priors of its own, of the frames."""
    steps: int
    stop_reason: str
    seconds: float

    @cached_property
    def at(self) -> Cameras:
        """Where both cameras are, with the stated distortion, for the compiled functions."""
        stated = cameras_at((self.dataset.primary, self.dataset.secondary), (AT_ORIGIN, self.pose))
        return stated._replace(q=np.asarray(self.unknowns.origin + self.unknowns.M @ self.p))

    @property
    def prior_cost(self) -> float:
        """Of priors and the measured baseline."""
        return float(self.p @ self.unknowns.precision @ self.p)

    @property
    def rig(self) -> Rig:
        """The refined cameras and their pose."""
        return Rig(self.primary, self.secondary, self.pose)

    @cached_property
    def standardised_residuals(self) -> FloatArray:
        """(n,): distances of all pairs from their epipolar lines over their standard deviations."""
        rows = self.dataset.correspondences
        return self.rig.epipolar_errors(rows.primary, rows.secondary) / self.sigma_px.value

    @cached_property
    def clusters(self) -> Clusters:
        """The frames that were not left out, in clusters of alike errors."""
        rows = self.dataset.correspondences.where(self.used_rows)
        return clusters_in(rows, self.rig, self.frames[~self.outlying])

    @property
    def used(self) -> IntArray:
        """Indices of the frames that were not left out."""
        return np.flatnonzero(~self.outlying)

    @property
    def fit(self) -> RobustFit:
        """The fit at its end, for normal equations of parts of the data."""
        found = self.fit_of(self.dataset, self.rows)
        found.outlying, found.chi_squares = self.outlying, self.chi_squares
        return found

    def fit_of(self, dataset: Pair, rows: BoolArray | None = None) -> RobustFit:
        """The fit of some points with the parameters and the noise of this one."""
        moving = self.settings.time_offset or self.settings.time_drift
        seen = Observations.of(dataset.recording, moving, dataset.of_both(rows))
        found = RobustFit(seen, self.unknowns, self.settings, self.at.R, np.empty((0, 4)))
        return found.take(self.p, self.sigma_px.value, self.scatter_m.value)

    @cached_property
    def design_effect(self) -> float:
        """How many times the clusters scatter more than independent frames would; at least 1."""
        if self.settings.of_rig is not None:
            return self.settings.of_rig.design_effect
        rows = self.dataset.correspondences.where(self.used_rows)
        places = rows.primary[np.unique(rows.frame, return_index=True)[1]]
        clusters = self.clusters
        # Errors of lenses may be alike at a place though neighbours do not show it.
        clusters = clusters if clusters.has_runs else in_equal_runs(clusters, places)
        return design_effect(self.fit, self.used, clusters)

    @cached_property
    def images_alone(self) -> tuple[FloatArray, FloatArray]:
        """Normal equations of images and lengths, without priors: H (Q, Q) and the gradient (Q,),
        of all unknowns, free or fixed. Frames that follow each other count less."""
        H, g, _ = self.fit.equations([self.used])
        return H[0] / self.design_effect, g[0] / self.design_effect

    @cached_property
    def p_covariance(self) -> FloatArray:
        """(k, k): covariance of the free parameters, priors included.

        Frames that follow each other count for less: the information of the images is divided by
        the `design_effect`. Where the same boards gave the lenses: `covariance_of_boards`.
        """
        found = self.unknowns.covariance(self.information / self.design_effect)
        without = lenses_without(self.dataset, self.settings)
        if not without or len(self.used) < FEWEST:
            return found
        H, g, _ = self.fit.equations([*self.used[:, None]])
        names = map(str, self.frames[self.used].tolist())
        equations = dict(zip(names, zip(H, g, strict=True), strict=True))
        return covariance_of_boards(self.unknowns, found, equations, without)

    @cached_property
    def p_covariance_by_model(self) -> FloatArray:
        """(k, k): the same if all frames were independent, for degrees of freedom."""
        return self.unknowns.covariance(self.information)

    @cached_property
    def covariance(self) -> FloatArray:
        """(Q, Q): covariance of the unknowns of `views`; 0 for fixed ones."""
        M = self.unknowns.M
        return np.asarray(M @ self.p_covariance @ M.T)

    @property
    def used_rows(self) -> BoolArray:
        """(n,): mask of the rows of the frames that were not left out."""
        used = np.isin(self.dataset.correspondences.frame, self.frames[~self.outlying])
        return np.asarray(used if self.rows is None else used & self.rows)

    @property
    def used_points_m(self) -> FloatArray:
        """(v, 2, 3): the points of the frames that were not left out."""
        return self.points_m[~self.outlying[self.frame_of]]

    @property
    def middles_m(self) -> FloatArray:
        """(f, 3): the middle of the bar of each frame, of an object of its longest distance."""
        first = np.searchsorted(self.frame_of, np.arange(len(self.frames)))
        return np.asarray(self.points_m[first].mean(axis=1))

    @property
    def outlying_frames(self) -> dict[int, float]:
        """The frames left out with their share of the total chi-square, largest first."""
        known = np.isfinite(self.chi_squares)
        largest = self.chi_squares[known].max(initial=1.0)
        finite = np.where(known, self.chi_squares, 10 * largest)
        share = finite / max(float(finite.sum()), 1e-300)
        order = np.argsort(-finite, kind="stable")
        return {int(self.frames[i]): float(share[i]) for i in order if self.outlying[i]}

    @property
    def bar_factor(self) -> float:
        """Estimated over stated length of the bar."""
        return float(self.at.q[FACTOR])

    @property
    def time_offset(self) -> MeasuredOffset:
        """The offset of the data set's points, with what the fit adds to it.

        The standard errors are 0 if it is not an unknown.
        """
        stated = self.dataset.time_offset or TimeOffset()
        late = [EACH + TIME, EACH + DRIFT]
        frames, drift = self.at.q[late].tolist()
        sigma = np.sqrt(np.diag(self.covariance)[late])
        return MeasuredOffset(
            stated.frames + frames,
            stated.drift + drift,
            stated.reference,
            float(sigma[0]),
            float(sigma[1]),
        )

    def apply(self, dataset: Pair) -> Pair:
        """A data set of the same rig, with the refined lenses instead of its own."""
        return dataset.changed(primary=self.primary, secondary=self.secondary)


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
    found: RobustFit | None = None
    tried = list[RobustFit]()
    for solve, is_only in _solves(dataset, settings, start, rows, near):
        if solve.run(tried) and (found is None or solve.better_than(found)):
            found = solve
        tried.append(solve)
        if found is not None and not found.outlying.any() and is_only:
            break
    if found is None or found.sigma_px > MAXIMUM_NOISE_PX:
        raise StereocalError(
            "The refined method found no pose of the cameras that fits: check that points, "
            "targets and camera files are not exchanged."
        )
    unknowns, p = _with_baseline(found, dataset)
    result = _result(found, dataset, rows, unknowns, p, clock() - started)
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
    found: RobustFit,
    dataset: Pair,
    rows: BoolArray | None,
    unknowns: Unknowns,
    p: FloatArray,
    seconds: float,
) -> RefinedResult:
    """The result of a fit at its end, with these unknowns of it."""
    rig = rig_of(dataset.primary, dataset.secondary, found.at)
    seen = np.isfinite(found.seen.pixels[:, :, 0, :1])
    return RefinedResult(
        dataset=dataset,
        settings=found.settings,
        pose=rig.pose,
        primary=rig.primary,
        secondary=rig.secondary,
        rows=rows,
        unknowns=unknowns,
        p=p,
        information=found.H,
        sigma_px=Noise(found.sigma_px, found.source_px),
        scatter_m=Noise(found.scatter, found.source_scatter),
        frames=found.frames,
        chi_squares=found.chi_squares,
        degrees_of_freedom=found.degrees_of_freedom,
        outlying=found.outlying,
        frame_of=found.frame_of,
        points_m=np.where(seen, found.points.reshape(-1, 2, 3), np.nan),
        cost=float(found.cost),
        steps=found.steps,
        stop_reason="converged" if found.converged else OUT_OF_STEPS,
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


def _with_baseline(found: RobustFit, dataset: Pair) -> tuple[Unknowns, FloatArray]:
    """The unknowns and the free parameters of a fit about a T of the measured length: the measured
    baseline is a prior of it, linear along T."""
    unknowns, p, T = found.at_end, found.p.copy(), found.at.q[OF_T]
    own, stated, origin = unknowns.M[OF_T].any(axis=0), T, unknowns.origin.copy()
    if len(found.baselines):
        stated = T * (dataset.baseline_m / np.linalg.norm(T))
    origin[OF_T], p[own] = stated, T - stated
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
    then: the others begin nearly where one before did.

    They are `start` or the essential pose, and a robust estimate, sorted by their residuals; and
    both with depths reversed, where that fits nearly as well.
    """
    if near is not None:
        solve, noise = fit_from(dataset, near.pose, settings, rows), near.sigma_px.value
        ended = near.unknowns.named(near.p)
        if solve.unknowns.names == near.unknowns.names and solve.start_near(
            ended, noise, near.scatter_m.value
        ):
            yield solve, True
    rays = dataset.rays if rows is None else np.ascontiguousarray(dataset.rays[:, rows])
    if start is None:
        with suppress(StereocalError):
            start = calibrate_essential(rays, dataset.baseline_m).pose
    elif dataset.baseline_m != start.baseline:
        start = replace(start, T=start.T * (dataset.baseline_m / start.baseline))
    robust = robust_start(dataset, rays) if settings.loss == "robust" else None
    known = [pose for pose in (start, robust) if pose is not None]
    off = sorted((median_residual(pose, rays), at) for at, pose in enumerate(known))
    starts = [known[at] for _, at in off]
    for residual, at in off:
        twin = depth_reversed(known[at], rays)
        if twin is not None and median_residual(twin, rays) < PLAUSIBLE * residual:
            starts.append(twin)
    apart: list[Pose] = []
    alike: list[Pose] = []
    for pose in starts:
        cosines = [pose.T @ it.T / (pose.baseline * it.baseline) for it in apart]
        (apart if max(cosines, default=0.0) < ALIKE else alike).append(pose)
    for at, pose in enumerate(apart + alike, 1):
        yield fit_from(dataset, pose, settings, rows), at >= len(apart)


def depth_reversed(pose: Pose, rays: FloatArray) -> Pose | None:
    """The pose that points in a small part of the images, nearly all at one depth, fit nearly as
    well: with their depths reversed, and the cameras turned about them the other way (Necker).

    None if no point is in front of both cameras.
    """
    points = triangulate_rays(pose.R, pose.T, rays)
    points = points[np.isfinite(points[:, 2])]
    if not len(points):
        return None
    middle = points.mean(axis=0)
    seen = pose.apply(middle)
    # Both views mirrored along the line of sight: together a rotation again.
    of_primary, of_secondary = (
        np.eye(3) - 2.0 * np.outer(at, at) / (at @ at) for at in (middle, seen)
    )
    R = of_secondary @ pose.R @ of_primary
    return Pose(R, seen - R @ middle)


def median_residual(pose: Pose, rays: FloatArray) -> float:
    """Of the absolute residuals of pairs with rays (4, n)."""
    return float(np.median(np.abs(residuals(pose.essential, rays[:2].T, rays[2:].T))))


def robust_start(dataset: Pair, rays: FloatArray) -> Pose | None:
    """The pose that `robust_pose` finds, with the baseline of the data set."""
    pose = robust_pose((dataset.primary, dataset.secondary), rays)
    return pose and Pose(pose.R, dataset.baseline_m * pose.T)


def robust_pose(cameras: Sequence[Camera], rays: FloatArray, samples: int = 1000) -> Pose | None:
    """The pose of an essential matrix robust to wrong pairs (MAGSAC++, from OpenCV), with a
    baseline of 1.

    None if there are fewer than 6 pairs or no solution.

    Args:
        rays: (4, n), as in `geometry`.
        samples: the largest number that is drawn; where few pairs are wrong, some ten are.
    """
    if rays.shape[1] < 6:
        return None
    focal = [
        np.median(camera.local_focal_px(points.T))
        for camera, points in zip(cameras, (rays[:2], rays[2:]), strict=True)
    ]
    E, _ = cv2.findEssentialMat(
        np.ascontiguousarray(rays[:2].T),
        np.ascontiguousarray(rays[2:].T),
        np.eye(3),
        method=cv2.USAC_MAGSAC,
        prob=0.9999,
        threshold=2.0 / float(np.sqrt(np.prod(focal))),
        maxIters=samples,
    )
    if E is None or np.shape(E) != (3, 3):
        return None
    R, t, in_front = choose_pose(np.asarray(E, dtype=np.float64), rays)
    return Pose(R, t) if in_front else None
