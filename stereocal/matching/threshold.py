"""Choose a matching threshold from the points themselves.

Let a frame have `n` correct pairs whose error e has density f and distribution F. Wrong partners
lie at any distance from the epipolar line, so near e = 0 the density of wrong pairs is uniform: `s`
per pixel. With a threshold t

    lost(t)  = n (1 - F(t))                     correct pairs beyond the threshold,
    wrong(t) = s * integral_0^t u(e) v(e) de    wrong pairs that are taken,
    u(e) = 1 - n F(e) / n_primary,  v(e) = 1 - n F(e) / n_secondary.

u and v are the fractions of points without their partner within e: since the assignment is
one-to-one, a wrong pair is taken only if both its points lack their own partner (missing, spurious
or lost). Without these factors half of the pairs of a dense flock would be lost. The chosen
threshold minimises lost + wrong. Two points that are nearer to each other's epipolar line than
their errors exchange partners: about s times the mean error, of the points with partners. That
hardly depends on the threshold, but is part of the stated share of wrong pairs.

n, s and f are those of `point_noise`, from the pairs of a sample of frames. Where correct pairs do
not stand out, the threshold is that of the parameter file, which is for points like the targets; or
a larger one that follows from a noise that is stated.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from stereocal.calibration.corrections import undistorted
from stereocal.errors import StereocalError
from stereocal.matching.matching import ANY_DEPTH, check_depths, checked_threshold
from stereocal.matching.pairs_of_rig import pairs_of
from stereocal.matching.point_noise import (
    FEWEST_PAIRS,
    Mixture,
    PairErrors,
    PointNoise,
    check_sigma,
    fit_noise,
    fit_pairs,
    found_within,
    noise_of_calibration,
    pair_errors,
    stated_noise,
)
from stereocal.rig.camera import CAMERAS
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded
from stereocal.system.sampling import evenly_spread

SAMPLE_FRAMES = 20
SAMPLE_POINTS = 2000
"""A sample has at least this many frames, and more until it has this many points."""
SAMPLE_PAIRS = 6000
PAIRS_PER_POINT = 3
"""Enough wrong pairs to estimate their density, and close enough to 0 for it to be uniform."""
NEAREST = 10 * PAIRS_PER_POINT
"""Pairs of each point that are looked at: enough for frames of different density."""
TAIL, TAIL_SCALE = 0.05, 3.0
"""Correct pairs of real detections that a sample may not show, and their scale over the others':
without them, 2 % of the pairs of the real recording were beyond the threshold."""
MAXIMUM_LOST = 0.5
"""A threshold that loses a larger fraction of the correct pairs is rejected."""
CLEAR = 0.05
"""The distributions are apart if at most this fraction of the pairs is lost, and of them wrong."""
MINIMUM_UNPARTNERED = 0.01
"""Lower limit of the fraction of points without a partner."""
LEAST_WRONG = 0.5
"""Number of wrong pairs assumed where none is seen."""
USUAL = 2.576
"""Standard deviations below which 99 % of normal errors are."""
LEAST_RELATIVE = 0.5
"""Reprojection error over the distance; exact points do not show it. Two like cameras have 0.71."""
UNLIKE_TARGETS = 5.0
"""Times the targets' noise from which on points are read as of undistorted images too, and times by
which they must fit better then."""
SHAPES = 100
"""Pairs whose errors stand for those of all correct pairs."""

FramePixels = tuple[FloatArray, FloatArray]
"""Raw pixels (n, 2) of the primary and (m, 2) of the secondary in one frame; or (n, 3) and (m, 3),
with the standard deviation of each point."""


@dataclass(frozen=True)
class Shares:
    """What a threshold does, by the estimate of correct and wrong pairs."""

    lost: float
    """Expected fraction of correct pairs beyond the threshold."""
    wrong: float
    """Expected fraction of wrong pairs among those taken."""

    @property
    def apart(self) -> bool:
        """Whether a threshold lies between the distributions of correct and of wrong pairs."""
        return max(self.lost, self.wrong) <= CLEAR


@dataclass(frozen=True)
class ThresholdChoice:
    """A threshold, and what it rests on."""

    threshold_px: float
    noise: PointNoise | None
    """Of the points; None if nothing is known."""
    targets: PointNoise | None
    """Noise of the calibration's targets, if known."""
    shares: Shares | None = None
    """None if correct and wrong pairs could not be separated."""
    is_forced: bool = False
    chosen_for: str = ""
    """What it was chosen for, and what that of the parameter file is for; empty if it is another's
    choice."""

    def sentence(self) -> str:
        """Noise, threshold, what it is for, and what it does."""
        of_file = ", that of the parameter file" * (self.shares is None and not self.is_forced)
        threshold = f"{rounded(self.threshold_px, 3)} px{self.chosen_for or of_file}"
        text = f"{self._about_noise()} Threshold {threshold}"
        if self.shares is None:
            return f"{text}."
        return (
            f"{text}: {_percent(1 - self.shares.lost)} of correct pairs are below it; "
            f"{_percent(self.shares.wrong, 'at most about ')} of the pairs found will be wrong."
        )

    def _about_noise(self) -> str:
        noise, targets = self.noise, self.targets
        if noise is not None and noise.source != "calibration":
            others = "" if targets is None else f" (the targets: {rounded(targets.sigma_px)} px)"
            return f"Your points scatter by {noise.in_words}{others}.{noise.disagreement}"
        used = None if noise is None else rounded(noise.sigma_px)
        instead = "" if noise is None else f", so that of the targets is used, {used} px"
        return (
            f"The noise of your points cannot be estimated (fewer than {FEWEST_PAIRS} pairs stand "
            f"out, or they are exact){instead}."
        )


def _percent(share: float, bound: str = "") -> str:
    """With a digit more near 0 and 100, which are never reached."""
    percent = 100 * share
    if percent < 0.05:
        return "less than 0.1 %"
    if percent > 99.95:
        return "more than 99.9 %"
    decimals = 1 if percent < 9.95 or percent > 90 else 0
    return f"{bound}{percent:.{decimals}f} %"


def sample_of(frames: Sequence[int] | IntArray, points_per_frame: float) -> set[int]:
    """Evenly spaced frames to choose a threshold from."""
    wanted = max(SAMPLE_FRAMES, int(np.ceil(SAMPLE_POINTS / max(points_per_frame, 1e-9))))
    return {int(frames[k]) for k in evenly_spread(len(frames), wanted)}


def choose_threshold(
    rig: RigParameters,
    frames: Sequence[FramePixels],
    depths_m: tuple[float, float] = ANY_DEPTH,
    sigma_px: float | None = None,
    threshold_px: float | None = None,
) -> ThresholdChoice:
    """The threshold that minimises lost plus wrong pairs, and the noise of the points.

    Args:
        frames: 20 frames are enough if they have many points; see `sample_of`.
        sigma_px: noise of the points, if it is known; None: by the points, if they state it, else
            estimated, else that of the calibration.
        threshold_px: the threshold, if it is given.

    Raises:
        StereocalError: no threshold can be chosen, or the points fit far better as of undistorted
            images.
    """
    choice = _chosen(rig, frames, depths_m, sigma_px, threshold_px)
    noise, targets = choice.noise, choice.targets
    if noise is None or targets is None or noise.source != "estimated":
        return choice
    if noise.sigma_px < UNLIKE_TARGETS * targets.sigma_px:
        return choice
    read = dict[str, float]()
    for which in (CAMERAS[:1], CAMERAS[1:], CAMERAS):
        lenses = {name: undistorted(getattr(rig, name)) for name in which}
        if known := {name: lens for name, lens in lenses.items() if lens is not None}:
            pinholes: dict[str, Any] = {str(name): lens for name, lens in known.items()}
            with suppress(StereocalError):
                other = _chosen(replace(rig, **pinholes), frames, depths_m, None, None).noise
                if other is not None and other.source == "estimated":
                    read[" and ".join(which)] = other.sigma_px
    whose = min(read, key=lambda names: read[names], default="")
    if whose and UNLIKE_TARGETS * read[whose] < noise.sigma_px:
        raise StereocalError(
            f"The points of the {whose} camera{'s' * (' and ' in whose)} seem to be of undistorted "
            f"images: they scatter by {rounded(read[whose])} px then, and by "
            f"{rounded(noise.sigma_px)} px as given (the targets: {rounded(targets.sigma_px)} px). "
            "Give the points of the images as recorded."
        )
    return choice


def _chosen(
    rig: RigParameters,
    frames: Sequence[FramePixels],
    depths_m: tuple[float, float],
    sigma_px: float | None,
    threshold_px: float | None,
) -> ThresholdChoice:
    """The threshold of points as they are given."""
    if threshold_px is not None:
        checked_threshold(rig, threshold_px)
    check_sigma(sigma_px)
    sample = _sample(rig, frames, depths_m)
    mixture, noise = _fits(rig, sample, sigma_px)
    targets = noise_of_calibration(rig)
    if mixture is not None:
        chosen, shares = _choose(mixture, sample, threshold_px)
        if threshold_px is not None:
            return ThresholdChoice(chosen, noise, targets, shares, is_forced=True)
        if shares.lost <= MAXIMUM_LOST:
            what_for = _chosen_for(rig, float(sample.points.max()) / len(frames))
            return ThresholdChoice(chosen, noise, targets, shares, chosen_for=what_for)
    if threshold_px is not None:
        return ThresholdChoice(threshold_px, noise, targets, is_forced=True)
    of_noise = 0.0
    if sigma_px is not None and len(sample.errors):
        of_noise = USUAL * sigma_px * max(float(np.median(sample.errors.relative)), LEAST_RELATIVE)
    if of_noise > (rig.matching_threshold_px or 0.0):
        what_for = ", above 99 % of the errors of correct pairs by that noise"
        return ThresholdChoice(of_noise, noise, targets, chosen_for=what_for)
    if rig.matching_threshold_px is None:
        why = "no pair of points meets in front of both cameras."
        if len(sample.errors):
            why = (
                "correct and wrong pairs cannot be separated, because there are too few points, "
                "they are too dense for this parameter set, or it does not fit them. Match with "
                "the 2D or the refined set, narrow the depth range, or state a threshold in pixels."
            )
        raise StereocalError(f"No threshold can be chosen: {why}")
    return ThresholdChoice(rig.matching_threshold_px, noise, targets)


def _chosen_for(rig: RigParameters, points_per_frame: float) -> str:
    """The fewer points a frame has, the fewer wrong pairs are to be kept out, and the larger is the
    threshold. That of a file knows no number of points: it weighs one correct pair of the targets
    against one wrong pair. (0.91 px there and 1.84 px for the one point a frame of the real
    recording, with the same refined set.)"""
    in_file, density = rig.matching_threshold_px, rounded(points_per_frame)
    weighed = "for as many wrong pairs as correct ones"
    other = "" if in_file is None else f" (in its file {rounded(in_file)} px, {weighed})"
    points = f"{density} point{'s' * (density != '1')} a frame"
    return f", chosen for {points} and the {rig.set_name}{other}"


@dataclass(frozen=True, eq=False)
class _Sample:
    """The errors of all pairs up to a limit."""

    errors: PairErrors
    limit_px: float
    points: FloatArray
    """(2,): of either camera."""
    thinning: float
    """Pairs up to the limit over those in `errors`."""
    has_sigmas: bool


def _sample(
    rig: RigParameters, frames: Sequence[FramePixels], depths_m: tuple[float, float]
) -> _Sample:
    near, far = check_depths(depths_m)
    sides: tuple[list[FloatArray], list[FloatArray]] = ([], [])
    rays = zip(*(_undistorted(rig, k, frames) for k in (0, 1)), strict=True)
    numbers, errors, wanted, cut = [], [np.empty(0)], 0, False
    for number, ((primary, secondary), both) in enumerate(zip(frames, rays, strict=True)):
        first, second, px, _, _ = pairs_of(rig, both[0], both[1], np.inf, near, far)
        few = min(len(primary), len(secondary))
        wanted += min(PAIRS_PER_POINT * few, max(len(px) // 2, few + 1))
        nearest = np.argsort(px, kind="stable")[: NEAREST * few]
        cut |= len(nearest) < len(px)
        sides[0].append(primary[first[nearest]])
        sides[1].append(secondary[second[nearest]])
        errors.append(px[nearest])
        numbers.append(np.full(len(nearest), number))
    points = np.array([[len(p), len(s)] for p, s in frames] or [[0, 0]], dtype=np.float64)
    pooled = np.concatenate(errors)
    order = np.argsort(pooled, kind="stable")[:wanted]
    cut |= len(order) < len(pooled)
    thinning = max(len(order) // SAMPLE_PAIRS, 1)
    if not len(order):
        return _Sample(PairErrors.none(), 0.0, points.sum(axis=0), 1.0, False)
    largest = float(pooled[order[-1]])
    order = order[::thinning]
    one, two = (np.concatenate(side)[order] for side in sides)
    kept = pair_errors(rig, one, two, np.concatenate(numbers)[order])
    limit = float(np.hypot(*rig.primary.image_size))
    if cut:
        # All pairs up to this distance have an error up to the largest.
        limit = largest / float(np.quantile(kept.relative, 0.99))
    kept = kept.where(kept.off_px <= limit)
    states = all(np.isfinite(np.concatenate(side)[:, 2:]).any() for side in sides)
    return _Sample(kept, limit, points.sum(axis=0), thinning, states and len(kept) > 0)


def _undistorted(rig: RigParameters, k: int, frames: Sequence[FramePixels]) -> list[FloatArray]:
    """(n, 2) rays of the points of each frame, undistorted all at once."""
    sides = [frame[k][:, :2] for frame in frames]
    rays = getattr(rig, CAMERAS[k]).rays_of(np.concatenate([np.empty((0, 2)), *sides]))
    return np.split(rays, np.cumsum([len(side) for side in sides])[:-1]) if sides else []


def _fits(
    rig: RigParameters, sample: _Sample, sigma_px: float | None
) -> tuple[Mixture | None, PointNoise | None]:
    """Correct and wrong pairs, if they can be separated, and the noise, if it is known."""
    errors = sample.errors
    if sigma_px is not None:
        errors = replace(errors, stated=np.full(len(errors), sigma_px))
    mixture = fit_pairs(errors, sample.limit_px)
    mixture = mixture if mixture is not None and mixture.is_clear else None
    limit = sample.limit_px if mixture is None else mixture.limit_px
    if sigma_px is not None or sample.has_sigmas:
        at_stated = fit_noise(errors, limit, 1.0)
        typical = sigma_px or float(np.sqrt(np.mean(errors.stated**2)))
        noise = stated_noise(typical, sigma_px is None, mixture)
        return (at_stated if at_stated is not None and at_stated.stands_out else None), noise
    with_rig = None if mixture is None else fit_noise(errors, limit)
    if with_rig is not None and with_rig.is_clear:
        return mixture, PointNoise(with_rig.deviation, "estimated", with_rig.relative_error)
    return mixture, noise_of_calibration(rig)


def _choose(mixture: Mixture, sample: _Sample, threshold: float | None) -> tuple[float, Shares]:
    """The threshold of least lost + wrong, over all frames together, unless it is given.

    lost(t) and wrong(t) are those of the module (docs/matching.md, "The threshold"): n is
    `correct`, F(t) `inside`, s `per_px`, and the integral up to t `taken`, by trapezoids.
    """
    errors = mixture.errors
    near = np.flatnonzero(errors.off_px <= 3 * mixture.scales)
    near = near[evenly_spread(len(near), SHAPES)]
    scales = (errors.relative * mixture.scales)[near]
    limit = mixture.limit_px * float(np.median(errors.relative[near]))
    edges = np.concatenate([[0.0], np.geomspace(1e-2 * scales.min(), limit, 2000)])
    if threshold is not None:
        edges = np.unique(np.append(edges, threshold))
    within = edges[:, None] / scales
    inside = (1 - TAIL) * found_within(within, mixture.degrees).mean(axis=1)
    inside += TAIL * found_within(within / TAIL_SCALE, mixture.degrees).mean(axis=1)
    correct = mixture.correct * sample.thinning
    others = (1 - mixture.share) * len(errors) * sample.thinning
    per_px = max(others, LEAST_WRONG) / limit
    partnered = np.minimum(correct / sample.points, 1 - MINIMUM_UNPARTNERED)
    free = (1 - partnered[0] * inside) * (1 - partnered[1] * inside)
    taken = np.concatenate([[0.0], np.cumsum(0.5 * (free[1:] + free[:-1]) * np.diff(edges))])
    cost = correct * (1 - inside) + per_px * taken
    k = int(np.argmin(cost)) if threshold is None else int(np.searchsorted(edges, threshold))
    # The mean error is the integral of 1 - F.
    mean_error = float(np.sum((1 - 0.5 * (inside[1:] + inside[:-1])) * np.diff(edges)))
    # Points without a partner are taken once.
    alone = float(np.min((1 - partnered) * sample.points))
    wrong = alone * -np.expm1(-per_px * taken[k] / alone)
    wrong += per_px * float(np.prod(partnered)) * min(mean_error, edges[k])
    shares = Shares(float(1 - inside[k]), float(wrong / max(wrong + correct * inside[k], 1e-300)))
    return float(edges[k]), shares
