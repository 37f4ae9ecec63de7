"""Frames as they could be recorded next: where their bars are, and the noise of their points.

The bars are between two assumptions about how people place them.

Frames to come repeat the recorded ones (a smoothed bootstrap), or they fill the volume evenly. The
recorded bars alone cannot tell, and errors of a set that fits them by bending its angles grow
between and beyond them: with the bootstrap alone, forecasts were 15 to 20 % too small where lenses
were wrong, with even bars alone 10 % too large where nothing was. So every second draw of the truth
has bars of the other kind, and the intervals contain the difference.

Bootstrap: each draw weights the recorded bars at random (Rubin 1981). A bar is moved by a normal
kernel in its direction from the primary camera and the logarithm of its depth, and turned by one
that follows how the recorded directions spread: bars that all point along one axis stay so. Bars
that would leave the volume or an image are moved less, or not at all.

The noise, with its uncertainty and its tails, is that of the standardised residuals. The four pixel
coordinates of a pair have one combination that no position of the target can absorb: the distance
from the epipolar line. The other three move the reconstructed point, and show in the lengths of the
bars. Both noises need not be alike: a wrong distortion, or cameras that are slightly out of step,
add to the first (on a real recording it was 1.4 times the second). A residual over its standard
deviation, and over the share of it that the fit has not absorbed, is 1 on average. The distribution
across the lines is that of Student with unknown scale and degrees of freedom; their posterior is
computed on a grid. Half of the prior belongs to the normal distribution, and half to equal noise
along and across the lines. Lengths that vary more than the noise explains do so because of
the bar, or because of the noise along the lines: each draw takes one of both, by their likelihoods.
"""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from stereocal.errors import StereocalError
from stereocal.fit.errors.uncertainty import bar_innovations, length_freedom
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.volume import Volume
from stereocal.system.array_types import BoolArray, FloatArray, IntArray
from stereocal.verdict.judging import photograph

DIMENSIONS = 5
BANDWIDTHS = (1.5, 1.5, 1.5, 1.0, 0.5, 0.0)
"""Tried in turn, in units of Silverman's for a normal distribution."""
EVEN_TRIES = 6
GROUP = 5
"""Frames within which wrong pairs are formed, as in the paper."""
MINIMUM_BARS = 3
DEGREES = np.array([3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, np.inf])
PRIOR = np.append(np.full(len(DEGREES) - 1, 0.5 / (len(DEGREES) - 1)), 0.5)
SCALES = np.geomspace(0.25, 4.0, 200)
LARGEST_SHIFT = 99
"""Noise along over noise across the lines is between 0.25 and 4; in steps of `SCALES`."""
MANY_BARS = 1000
"""With more recorded bars, a number for each of them and each group is too much to draw."""


def fresh_bars(model: RefinedResult, draws: int, bars: int, rng: np.random.Generator) -> FloatArray:
    """Ends A and B of fresh bars, (draws, bars, 2, 3) in metres in the primary's frame.

    Every second draw is filled evenly, as far as `EVEN_TRIES` find places for its bars; all others
    are the smoothed bootstrap of the module (docs/trust.md, "How it is made"), with bandwidths that
    get smaller until a bar is in the volume and in view.
    """
    ends = model.used_points_m
    ends = ends[np.isfinite(ends).all(axis=(1, 2))]
    if len(ends) < MINIMUM_BARS:
        raise StereocalError("A forecast needs at least 3 bars with both targets.")
    middles, along = ends.mean(axis=1), ends[:, 0] - ends[:, 1]
    lengths = np.linalg.norm(along, axis=1)
    wide, directions = model.primary.is_fisheye, along / lengths[:, None]
    places = _places(middles, wide)
    places[:, 2] = np.log(places[:, 2])
    in_front = ends.reshape(-1, 3)[ends[:, :, 2].ravel() > 0]
    volume = Volume.around(_places(in_front, wide))
    drawn = _drawn(len(ends), draws, bars, rng)
    # Silverman's bandwidth over the standard deviation: (4 / ((d + 2) n))^(1 / (d + 4)).
    rule = (4 / ((DIMENSIONS + 2) * len(ends))) ** (1 / (DIMENSIONS + 4))
    to_camera = wide and _stand_by_rays(places, directions)
    if to_camera:
        directions = np.einsum("nji,nj->ni", _facing(places), directions)
    spread, axes = _root(np.cov(places.T)), _root(directions.T @ directions / len(ends))
    even = np.broadcast_to(np.arange(draws)[:, None] % 2 == 0, drawn.shape)
    fresh = ends[drawn]
    missing = np.ones(drawn.shape, dtype=np.bool_)
    for factor in (*(None,) * EVEN_TRIES, *BANDWIDTHS):
        wanted = missing & even if factor is None else missing
        chosen = drawn[wanted]
        if factor is None:
            h = BANDWIDTHS[0] * rule
            moved = rng.uniform(*volume.limits, (len(chosen), 3))
            moved[:, 2] = np.log(moved[:, 2])
        else:
            h = factor * rule
            moved = places[chosen] + h * (rng.standard_normal((len(chosen), 3)) @ spread)
        turn = rng.standard_normal((len(chosen), 3)) @ axes
        turn -= np.sum(turn * directions[chosen], axis=1, keepdims=True) * directions[chosen]
        turned = directions[chosen] + h * turn
        if to_camera:
            turned = np.einsum("nij,nj->ni", _facing(moved), turned)
        turned *= 0.5 * (lengths[chosen] / np.linalg.norm(turned, axis=1))[:, None]
        moved[:, 2] = np.exp(moved[:, 2])
        middle = _points(moved, wide)
        bars_tried = np.stack([middle + turned, middle - turned], axis=1)
        seen = _seen(model, volume, bars_tried)
        filled = np.flatnonzero(wanted)[seen]
        fresh.reshape(-1, 2, 3)[filled] = bars_tried[seen]
        missing.reshape(-1)[filled] = False
    return fresh


def _root(covariance: FloatArray) -> FloatArray:
    """(3, 3): standard normal rows times it have the covariance, which may be singular."""
    values, axes = np.linalg.eigh(covariance)
    return np.asarray(np.sqrt(np.maximum(values, 0.0))[:, None] * axes.T)


def _drawn(recorded: int, draws: int, bars: int, rng: np.random.Generator) -> IntArray:
    """(draws, bars): indices of recorded bars, each draw with its own weights.

    Within `GROUP` bars in turn none is drawn twice (Gumbel's maxima): two copies of a bar would be
    closer together than any two that were recorded, and wrong pairs of them are accepted.
    """
    weights, groups = rng.dirichlet(np.ones(recorded), draws), -(-bars // GROUP)
    if recorded > MANY_BARS:
        drawn = np.array([_distinct(of_draw, groups, rng) for of_draw in weights])
        return np.asarray(drawn.reshape(draws, -1)[:, :bars])
    keys = np.log(np.maximum(weights, 1e-300))[:, None] + rng.gumbel(size=(draws, groups, recorded))
    size = min(GROUP, recorded)
    drawn = np.argpartition(-keys, size - 1, axis=-1)[..., :size]
    return np.asarray(drawn.reshape(draws, -1)[:, np.arange(bars) % (groups * size)])


def _distinct(weights: FloatArray, groups: int, rng: np.random.Generator) -> IntArray:
    """(groups, GROUP): indices by weights (n,), drawn again where they repeat one of their group:
    the same distribution as that of Gumbel's maxima."""
    up_to = np.cumsum(weights)
    indices = np.empty((groups, GROUP), dtype=np.int64)
    again = np.ones(indices.shape, dtype=np.bool_)
    while again.any():
        indices[again] = np.searchsorted(up_to, up_to[-1] * rng.random(int(again.sum())))
        again = np.tril(indices[:, :, None] == indices[:, None, :], -1).any(axis=2)
    return indices


def _places(points: FloatArray, wide: bool) -> FloatArray:
    """(n, 3): direction and depth of points (n, 3) in the primary's frame: x/z, y/z and z.

    Args:
        wide: the camera is a fisheye: the two components of the angle from the axis, and the
            distance. On the plane z = 1 nearly all directions are at the rim, and there the depth
            of a bar in the middle is a place many times farther away than any bar was.
    """
    x, y, z = points.T
    if not wide:
        return np.column_stack([x / z, y / z, z])
    r = np.maximum(np.hypot(x, y), 1e-12)
    angle = np.arctan2(r, z)
    return np.column_stack([angle * x / r, angle * y / r, np.hypot(r, z)])


def _points(places: FloatArray, wide: bool) -> FloatArray:
    """The inverse of `_places`."""
    x, y, z = places.T
    if not wide:
        return np.column_stack([x * z, y * z, z])
    angle = np.maximum(np.hypot(x, y), 1e-12)
    across = z * np.sin(angle) / angle
    return np.column_stack([across * x, across * y, z * np.cos(angle)])


def _facing(places: FloatArray) -> FloatArray:
    """(n, 3, 3): the least rotations of the axis of a fisheye to the directions of `_places`."""
    angle = np.maximum(np.hypot(places[:, 0], places[:, 1]), 1e-12)
    x, y = places[:, 0] / angle, places[:, 1] / angle
    s, c = np.sin(angle), np.cos(angle)
    rows = (
        (c * x * x + y * y, (c - 1.0) * x * y, s * x),
        ((c - 1.0) * x * y, c * y * y + x * x, s * y),
        (-s * x, -s * y, c),
    )
    return np.moveaxis(np.array(rows), 2, 0)


def _stand_by_rays(places: FloatArray, directions: FloatArray) -> bool:
    """Whether bars (n, 3) are more alike as seen along their rays than in space: boards are turned
    to the camera, and poles stand upright."""
    by_ray = np.einsum("nji,nj->ni", _facing(places), directions)
    spreads = [np.linalg.det(vectors.T @ vectors) for vectors in (directions, by_ray)]
    return bool(spreads[1] < spreads[0])


def _seen(model: RefinedResult, volume: Volume, bars: FloatArray) -> BoolArray:
    """(n,): whether both ends of bars (n, 2, 3) are in the volume and in both images."""
    points = np.ascontiguousarray(bars.reshape(-1, 3))
    pixels = np.empty((len(points), 4))
    photograph(model.at, points, pixels)
    sizes = np.array([*model.primary.image_size, *model.secondary.image_size]) - 0.5
    seen = ((pixels > -0.5) & (pixels < sizes)).all(axis=1) & (points[:, 2] > 0)
    seen &= volume.has(_places(points, model.primary.is_fisheye))
    others = model.pose.apply(points)
    seen &= others[:, 2] > 0
    for camera, xyz in ((model.primary, points), (model.secondary, others)):
        if camera.is_fisheye:
            seen &= camera.uses(xyz[:, :2] / xyz[:, 2:])
    return np.asarray(seen.reshape(-1, 2).all(axis=1))


@dataclass(frozen=True)
class NoiseDraws:
    """Draws of what describes the noise, each (draws,)."""

    across: FloatArray
    """Noise across the epipolar lines, relative to that of the model."""
    along: FloatArray
    """The noise that moves the reconstructed point, relative to `across`."""
    degrees: FloatArray
    """Degrees of freedom; infinite if normal."""


def draw_noise(model: RefinedResult, draws: int, rng: np.random.Generator) -> NoiseDraws:
    residuals = model.standardised_residuals[model.used_rows]
    M, used = model.unknowns.M, ~model.outlying
    spent = float(np.sum(model.p_covariance_by_model * (M.T @ model.information @ M)))
    freedom = float(model.degrees_of_freedom[used].sum())
    pairs = float(np.isfinite(model.used_points_m[:, :, 0]).sum())
    left = max(pairs * (1.0 - spent / freedom), 1.0)
    bars = bar_innovations(model, model.used_rows)
    known, absorbed = np.isfinite(bars.errors_m), length_freedom(model, bars)
    of_bar = np.array([[model.scatter_m.value], [0.0]])
    sigmas = np.sqrt(bars.variances_m2[known] + of_bar**2)
    lengths = bars.errors_m[known]
    return noise_given(residuals, len(residuals) - left, lengths, sigmas, absorbed, draws, rng)


def noise_given(
    residuals: FloatArray,
    absorbed: float,
    lengths: FloatArray,
    sigmas: FloatArray,
    absorbed_lengths: float,
    draws: int,
    rng: np.random.Generator,
) -> NoiseDraws:
    """Draw the noise given the standardised residuals of pairs (n,) and errors of lengths (m,).

    Args:
        absorbed, absorbed_lengths: degrees of freedom of either that the fit has absorbed.
        sigmas: (k, m): standard deviations of the errors by each of k causes, equally likely.
    """
    density = _log_density(residuals, np.ones(len(residuals)), absorbed) + np.log(PRIOR)[:, None]
    chance = np.exp(density - density.max()).ravel()
    drawn = rng.choice(chance.size, draws, p=chance / chance.sum())
    of_scale, of_degrees = drawn % len(SCALES), drawn // len(SCALES)
    shifts = np.arange(-LARGEST_SHIFT, LARGEST_SHIFT + 1)
    prior = np.where(shifts == 0, 0.5, 0.5 / (2 * LARGEST_SHIFT))
    shifted = np.clip(of_scale[:, None] + shifts, 0, len(SCALES) - 1)
    of_causes = [
        _log_density(lengths, deviations, absorbed_lengths)[of_degrees[:, None], shifted]
        for deviations in sigmas
    ]
    chances = np.hstack([of_cause + np.log(prior) for of_cause in of_causes])
    chosen = np.argmax(chances + rng.gumbel(size=chances.shape), axis=1)
    chosen = shifts[chosen % len(shifts)]
    along = np.exp(chosen * np.log(SCALES[1] / SCALES[0]))
    return NoiseDraws(SCALES[of_scale], along, DEGREES[of_degrees])


def _log_density(residuals: FloatArray, sigmas: FloatArray, absorbed: float) -> FloatArray:
    """(DEGREES, SCALES): log-likelihood of residuals (n,) with standard deviations (n,)."""
    n = max(len(residuals), 1)
    left = max(len(residuals) - absorbed, 1.0) / n
    squares = np.square(residuals / sigmas) / left
    density = np.empty((len(DEGREES), len(SCALES)))
    for i, nu in enumerate(DEGREES):
        ratio = squares[:, None] / np.square(SCALES)
        if np.isinf(nu):
            shape = -0.5 * ratio - 0.5 * np.log(2 * np.pi)
        else:
            constant = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
            shape = constant - 0.5 * (nu + 1) * np.log1p(ratio / nu)
        density[i] = left * (shape - np.log(sigmas[:, None] * SCALES)).sum(axis=0)
    return density


def noise_of_points(degrees: FloatArray, points: int, rng: np.random.Generator) -> FloatArray:
    """Noise of u, v in both images in units of the scale, (draws, points, 4). The two coordinates
    of a point share a factor, so that a point that is off is off in both."""
    noise = rng.standard_normal((len(degrees), points, 4))
    for of_draw, nu in zip(noise, degrees, strict=True):
        if np.isfinite(nu):
            factor = np.sqrt(nu / rng.chisquare(nu, (points, 2)))
            of_draw *= np.repeat(factor, 2, axis=1)
    return noise
