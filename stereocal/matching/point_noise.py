"""The noise of image points, estimated from the points themselves.

The four pixel coordinates of a pair have one combination that no 3D point explains: its distance
from the epipolar geometry. For a correct pair it is normal with the variance

    k^2 b^2 + v,

where b is the standard deviation that the points state of themselves, or 1 px; k is the factor, or
noise, to be estimated; and v comes from the errors of the parameters. Wrong pairs lie at any
distance, so near 0 their density is uniform. k and the share of correct pairs are fitted to all
pairs up to a limit, by maximum likelihood, with both densities cut off at the limit: neither the
cut nor wrong pairs bias the noise. For detections with tails, Student's distribution replaces the
normal where the errors show it.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import gammaln, ndtr, stdtr

from stereocal.errors import StereocalError
from stereocal.fit.errors.uncertainty import point_jacobians
from stereocal.fit.least_squares.small_steps import rig_at
from stereocal.matching.reconstruction import noise_of_file
from stereocal.rig.parameters import RigParameters
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import POSSIBLE_PX, rounded, with_error

EXACT_PX = 1e-3
"""Errors of exact points count as this."""
FEWEST_PAIRS = 20
"""Of correct pairs; fewer do not show their noise."""
LARGEST_UNCERTAINTY = 0.3
"""Relative standard error of an estimate above which it counts as none."""
EVIDENCE = 30.0
"""Required value of twice the gain in log likelihood by the peak; chance gives 10 at most."""
DEGREES = (np.inf, 10.0, 5.0)
TAIL_EVIDENCE = 20.0
"""The same for a distribution with tails, instead of the normal."""
CONTRADICTION = 1.5
"""Ratio of seen and stated noise above which they contradict each other."""
WIDE = 25.0
"""Limit over the noise: beyond it, wrong pairs need not have the density that they have near 0."""
RESOLVED = 10.0
"""A peak is no narrower one's surroundings if the limit is larger by this factor."""
ZOOMS = 8
SCALES, FEW = 60, 1500
"""Of the search for a start: scales, and pairs."""


@dataclass(frozen=True)
class PointNoise:
    """The noise of image points."""

    sigma_px: float
    """Standard deviation of an image coordinate; the root mean square of what columns state."""
    source: Literal["estimated", "stated", "columns", "calibration"]
    relative_error: float = 0.0
    """Standard error of an estimate over its value."""
    seen_px: float | None = None
    """What the errors of the pairs show, where the noise is stated and they contradict it."""

    @property
    def in_words(self) -> str:
        if self.source == "estimated":
            return f"{with_error(self.sigma_px, self.relative_error * self.sigma_px)} px"
        where = "stated" if self.source == "stated" else "their columns state"
        return f"{rounded(self.sigma_px)} px, as {where}"

    @property
    def disagreement(self) -> str:
        """A sentence where the errors of the pairs contradict what is stated, or nothing."""
        if self.seen_px is None:
            return ""
        return f" Their epipolar errors show {rounded(self.seen_px)} px."


FAR_PX, FAR_TIMES = 10.0, 20.0
"""A scatter above this, and above so many times the noise of the targets, is rarely noise: that of
animals is 1 to 5 px."""


def on_far(px: float, targets_px: float | None) -> str:
    """A note on points that scatter as those of other moments or cameras do, or nothing."""
    if px <= max(FAR_PX, FAR_TIMES * (targets_px or 0.0)):
        return ""
    return (
        f"A scatter of {rounded(px)} px is rarely noise: make sure that both tables count the "
        "frames alike, that the cameras are not exchanged, and that points are counted from the "
        "upper left."
    )


REPAIRED_TIMES = 4.0
"""Times the noise of the images that repaired parameters come from, from which on points do not fit
them. Points recorded before a turn of 0.2 degrees scatter 6.6 times as much."""


def on_repaired(px: float, repaired_px: float) -> str:
    """A note on points that do not fit repaired parameters, or nothing."""
    if px <= REPAIRED_TIMES * repaired_px:
        return ""
    return (
        f"With the repaired parameters your points scatter by {rounded(px)} px, the images of the "
        f"repair by {rounded(repaired_px)} px. Match points recorded before the movement with the "
        "parameters of before; where these are of later, check the parameters again, with new bars."
    )


def check_sigma(sigma_px: float | None) -> None:
    low, high = POSSIBLE_PX
    if sigma_px is not None and not low <= sigma_px <= high:
        raise StereocalError(
            f"The noise of the points is {sigma_px} px: it must be from {low:g} to {high:g} px."
        )


def noise_of_calibration(rig: RigParameters) -> PointNoise | None:
    """The noise of the calibration's targets, if the parameter file states it."""
    value = noise_of_file(rig)[0] or rig.noise_px
    return PointNoise(value, "calibration") if value else None


@dataclass(frozen=True, eq=False)
class PairErrors:
    """Errors of n pairs, correct and wrong ones."""

    off_px: FloatArray
    """(n,) distance from the epipolar geometry, in pixels of all four coordinates together."""
    of_rig: FloatArray
    """(n,) its variance by the errors of the parameters, px^2."""
    stated: FloatArray
    """(n,) its standard deviation by what the points state; 1 where they state nothing."""
    error_px: FloatArray
    """(n,) reprojection error, which matching compares with the threshold."""
    frame: IntArray
    """(n,) errors within a frame may be alike."""

    def __len__(self) -> int:
        return len(self.off_px)

    @classmethod
    def none(cls) -> "PairErrors":
        no = np.empty(0)
        return cls(no, no, no, no, np.empty(0, np.int64))

    @property
    def relative(self) -> FloatArray:
        """(n,) reprojection error over the distance, which the geometry determines."""
        return np.asarray(self.error_px / np.maximum(self.off_px, 1e-300))

    def scales(self, factor: float) -> FloatArray:
        """(n,): scale of the errors of correct pairs."""
        return np.sqrt((factor * self.stated) ** 2 + self.of_rig)

    def where(self, kept: np.typing.NDArray[np.bool_]) -> "PairErrors":
        return PairErrors(*(getattr(self, name)[kept] for name in self.__dataclass_fields__))


def pair_errors(
    rig: RigParameters, primary: FloatArray, secondary: FloatArray, frame: IntArray
) -> PairErrors:
    """The errors of pairs that meet in front of both cameras; others are left out.

    Args:
        primary, secondary: (n, 2) raw pixels; or (n, 3), with their standard deviations.
        frame: (n,).
    """
    pixels = np.column_stack([primary[:, :2], secondary[:, :2]])
    xyz = rig.reconstruct(pixels[:, :2], pixels[:, 2:])
    by_point, by_shared = point_jacobians(rig_at(rig), np.ascontiguousarray(xyz))
    kept = np.asarray(np.isfinite(by_point).all(axis=(1, 2)))
    by_shared, pixels, xyz = by_shared[kept], pixels[kept], xyz[kept]
    columns, by_point = np.arange(4), by_point[kept].transpose(0, 2, 1)
    minors = [np.linalg.det(by_point[:, :, columns != k]) for k in columns]
    across = np.stack(minors, axis=1) * [1.0, -1.0, 1.0, -1.0]  # (n, 4), across the three rows
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    seen = np.column_stack([rig.primary.project(xyz), rig.secondary.project(rig.pose.apply(xyz))])
    _, covariance = noise_of_file(rig)
    by_rig = np.einsum("nji,nj->ni", by_shared, across)
    stated = np.ones(len(pixels))
    if primary.shape[1] > 2:
        sides = np.square(across).reshape(-1, 2, 2).sum(axis=2)
        sigmas = np.column_stack([primary[kept, 2], secondary[kept, 2]])
        stated = np.sqrt(np.sum(sides * sigmas**2, axis=1))
        unknown = ~np.isfinite(stated)
        stated[unknown] = np.median(stated[~unknown]) if not unknown.all() else 1.0
    return PairErrors(
        np.hypot(np.einsum("ni,ni->n", across, pixels - seen), EXACT_PX),
        np.zeros(len(pixels))
        if covariance is None
        else np.einsum("ni,ni->n", by_rig @ covariance, by_rig),
        stated,
        rig.reprojection_errors(pixels[:, :2], pixels[:, 2:]).mean(axis=1),
        frame[kept],
    )


@dataclass(frozen=True, eq=False)
class Mixture:
    """Correct and wrong pairs among errors up to a limit."""

    errors: PairErrors
    limit_px: float
    factor: float
    """k: the noise in px, or over that which the points state."""
    share: float
    """Of correct pairs."""
    degrees: float
    log_likelihood: float

    @property
    def gain(self) -> float:
        """Twice the log likelihood over that of wrong pairs alone."""
        return 2 * float(self.log_likelihood + len(self.errors) * np.log(self.limit_px))

    @property
    def scales(self) -> FloatArray:
        """(n,): scale of the error of each pair, if it is correct."""
        return self.errors.scales(self.factor)

    @property
    def scale(self) -> float:
        """Median of the scales."""
        return float(np.median(self.scales))

    @property
    def correct(self) -> float:
        return self.share * len(self.errors)

    @cached_property
    def relative_error(self) -> float:
        """Standard error of `factor` over it, with errors in a frame alike (sandwich)."""
        step = 1e-4

        def changed(sign: int) -> FloatArray:
            """(2, n): log densities where the factor, and where the share, is larger."""
            more = np.exp(sign * step)
            ways = (self.factor * more, self.share), (self.factor, min(self.share * more, 1.0))
            peaks = (_peak(self.errors, self.limit_px, k, self.degrees) for k, _ in ways)
            return np.stack(
                [
                    np.log(share * peak + (1 - share) / self.limit_px)
                    for peak, (_, share) in zip(peaks, ways, strict=True)
                ]
            )

        up, down = changed(1), changed(-1)
        scores = (up - down) / (2 * step)
        information = np.linalg.pinv(scores @ scores.T)
        frames = np.unique(self.errors.frame, return_inverse=True)[1]
        of_frames = np.stack([np.bincount(frames, score) for score in scores])
        robust = information @ of_frames @ of_frames.T @ information
        of_points = self.factor * self.errors.stated
        of_normal = float(np.median((self.scales / of_points) ** 4)) / max(2 * self.correct, 1e-300)
        return float(np.sqrt(max(information[0, 0], robust[0, 0], of_normal)))

    @property
    def stands_out(self) -> bool:
        """Whether there are correct pairs."""
        return self.gain >= EVIDENCE and self.correct >= FEWEST_PAIRS

    @property
    def is_clear(self) -> bool:
        """Whether correct pairs stand out, and are enough to show their noise."""
        return self.stands_out and self.relative_error <= LARGEST_UNCERTAINTY

    @property
    def deviation(self) -> float:
        """k as a standard deviation, with the tails."""
        of_scale = np.sqrt(self.degrees / (self.degrees - 2)) if np.isfinite(self.degrees) else 1.0
        return float(self.factor * of_scale)


def stated_noise(sigma_px: float, by_columns: bool, mixture: Mixture | None) -> PointNoise:
    """A noise that is stated, and whether the errors of the pairs contradict it.

    Args:
        mixture: of errors over what is stated; None if correct pairs do not stand out.
    """
    seen = None
    if mixture is not None:
        off = abs(np.log(mixture.deviation))
        if off > max(np.log(CONTRADICTION), 3 * mixture.relative_error):
            seen = mixture.deviation * sigma_px
    return PointNoise(sigma_px, "columns" if by_columns else "stated", seen_px=seen)


def fit_pairs(errors: PairErrors, limit_px: float) -> Mixture | None:
    """Fit correct and wrong pairs, whatever makes correct pairs scatter; None without errors.

    Far from 0 the density of wrong pairs falls. Where that alone makes a peak, a narrower one is
    looked for inside it; and in the end the limit is a small multiple of the noise.

    Args:
        limit_px: all pairs up to this distance are among the errors.
    """
    errors = replace(errors, of_rig=np.zeros(len(errors)))
    mixture = fit_noise(errors, limit_px)
    zoom = limit_px
    for _ in range(ZOOMS):
        if mixture is None or mixture.scale < zoom / RESOLVED:
            break
        zoom /= 4.0
        inner = fit_noise(errors, zoom)
        if inner is not None and inner.is_clear and inner.scale < zoom / 4.0:
            mixture = inner
    for _ in range(ZOOMS):
        if mixture is None or not mixture.is_clear or WIDE * mixture.scale > 0.7 * mixture.limit_px:
            break
        mixture = fit_noise(errors, WIDE * mixture.scale)
    return mixture


def fit_noise(errors: PairErrors, limit_px: float, factor: float | None = None) -> Mixture | None:
    """Fit correct and wrong pairs with the errors of the parameters; None without errors.

    Args:
        limit_px: that of `fit_pairs`.
        factor: k, if it is known.
    """
    errors = errors.where(errors.off_px <= limit_px)
    if not len(errors) or not limit_px > 0:
        return None
    best: Mixture | None = None
    start = factor or _start(errors, limit_px)
    for degrees in DEGREES:
        mixture = _likeliest(errors, limit_px, start, degrees, factor is not None)
        if best is None:
            best, start = mixture, mixture.factor
            continue
        needed = 0.5 * TAIL_EVIDENCE if np.isinf(best.degrees) else 0.0
        if mixture.log_likelihood < best.log_likelihood + needed:
            break
        best = mixture
    return best


def _likeliest(
    errors: PairErrors, limit: float, start: float, degrees: float, is_known: bool
) -> Mixture:
    def mixture_at(log_factor: float) -> Mixture:
        factor = float(np.exp(log_factor))
        share, value = _best_share(errors, limit, factor, degrees)
        return Mixture(errors, limit, factor, share, degrees, value)

    if is_known:
        return mixture_at(np.log(start))
    optimum = minimize_scalar(
        lambda x: -mixture_at(x).log_likelihood,
        bounds=np.log(start) + np.array([-1.0, 1.0]),
        method="bounded",
        options={"xatol": 1e-3},
    )
    return mixture_at(float(optimum.x))


def _start(errors: PairErrors, limit: float) -> float:
    """The likeliest factor of a coarse search."""
    least = max(float(errors.off_px.min()), 1e-6 * limit)
    factors = np.geomspace(0.3 * least, limit, SCALES) / float(np.median(errors.stated))
    thin = errors.where(np.arange(len(errors)) % max(len(errors) // FEW, 1) == 0)
    values = [_best_share(thin, limit, factor, 7.0)[1] for factor in factors]
    return float(factors[int(np.argmax(values))])


def _best_share(
    errors: PairErrors, limit: float, factor: float, degrees: float
) -> tuple[float, float]:
    """The likeliest share of correct pairs, and its log likelihood.

    The density of an error is share * peak + (1 - share) / limit, that of the module; its log
    likelihood is concave in the share, and maximised by Newton's method. A step goes at most half
    of the way to 0 or to 1.
    """
    ratio = limit * _peak(errors, limit, factor, degrees) - 1.0
    share = 0.5
    for _ in range(60):
        slope = ratio / (1 + share * ratio)
        step = slope.sum() / max(float(np.square(slope).sum()), 1e-300)
        new = float(np.clip(share + step, 0.5 * share, 0.5 * (1 + share)))
        if abs(new - share) < 1e-7:
            break
        share = new
    value = np.log1p(share * ratio).sum() - len(errors) * np.log(limit)
    return share, float(value)


def _peak(errors: PairErrors, limit: float, factor: float, degrees: float) -> FloatArray:
    """(n,): density of correct pairs, cut off at the limit: normal, or Student's for finite
    degrees of freedom, of distances without their sign."""
    scales = errors.scales(factor)
    inside = found_within(limit / scales, degrees)
    squares = (errors.off_px / scales) ** 2
    if np.isinf(degrees):
        shape = np.exp(-0.5 * squares) / np.sqrt(2 * np.pi)
    else:
        half = 0.5 * (degrees + 1)
        norm = np.exp(gammaln(half) - gammaln(0.5 * degrees)) / np.sqrt(np.pi * degrees)
        shape = norm * (1 + squares / degrees) ** -half
    return np.asarray(2 * shape / scales / inside)


def found_within(relative: FloatArray, degrees: float) -> FloatArray:
    """Share of correct pairs up to a distance over the scale."""
    below = ndtr(relative) if np.isinf(degrees) else stdtr(degrees, relative)
    return np.asarray(2 * below - 1)
