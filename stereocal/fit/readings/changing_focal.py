"""A focal length that changes with the distance of what is held, as by an autofocus.

Let the focal length of a camera be f exp(k d), d being the logarithm of the distance of a frame
less its mean. The derivatives by k are those by f times d, so the normal equations of groups of
frames that are about as far, by all other unknowns, hold those of k. One Gauss-Newton step gives
its value, with lenses and lengths nearly free: what they explain is not taken for k (a score test).
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from stereocal.fit.least_squares.adjustment import add_baselines
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import lens_places
from stereocal.fit.least_squares.unknowns import (
    LensPrior,
    Unknowns,
    free_distortion,
    measured_baselines,
    unknowns_of,
)
from stereocal.fit.least_squares.views import OWN
from stereocal.fit.refined_result import RefinedResult
from stereocal.rig.camera import camera_in_words
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

DISTANCES = 12
"""Groups of frames that are about as far from a camera."""
FREE_LENS, FREE_LENGTH = LensPrior(0.1, 100.0), 0.1
"""Standard deviations of lenses and lengths, the latter a fraction, that hardly restrict them."""
LEAST_GAIN, LEAST_CHANGE = 25.0, 0.005
"""Fall of the chi-square, over what is left for each degree of freedom, and change of the focal
length that are worth a message. Largest fall of 192 sound pairs of bars of 9 kinds 12.9, of 78
parts of a real recording 12.6, with a wrong baseline, bar or lens, or a moved camera 18.8. With a
focal length that changes by 2 to 4 %, in 25 frames, 141 of 150 are more than 25."""
LEAST_EXPLAINED = 0.05
"""Part of what the other unknowns leave of the chi-square that must be explained: in thousands of
frames small errors of the lens model are significant too. Of whole real recordings 0.02 at most."""
LEAST_FREEDOM = 20
"""Degrees of freedom from which the noise is known."""
LEAST_INFORMATION = 1.0
"""With less, k has a standard error of 1, and nothing can be told."""
STANDS_OUT = 2.0
"""How many times more a change in one of three or more cameras must explain than one in another for
the camera to be named: 9 of 9 were the right one. Two cameras do not tell: 8 of 93 that stood out
by 12 were the wrong one."""


class _Change(NamedTuple):
    """How the focal length of a camera would change with the distance."""

    gain: float
    """By how much the chi-square falls, over what is left for each degree of freedom."""
    explained: float
    """By which part of it the chi-square falls."""
    camera: str
    fraction: float
    """From the nearest to the farthest frame."""
    from_m: float
    to_m: float


def changing_focal(fit: RobustFit, points_m: FloatArray, effect: Callable[[], float]) -> str:
    """A message if the focal length of a camera seems to change with the distance; else empty.

    Args:
        fit: at its end.
        points_m: (u, 2, 3): of its units, in the reference's frame.
        effect: its design effect.
    """
    unknowns, recording = _nearly_free(fit), fit.recording
    freedom = int(fit.degrees_of_freedom[fit.used].sum()) - len(unknowns.names)
    if freedom < LEAST_FREEDOM:
        return ""
    numbers = range(len(recording.cameras))
    *others, second, best = sorted(_change(fit, points_m, unknowns, freedom, n) for n in numbers)
    if (
        not best.gain > LEAST_GAIN
        or best.explained < LEAST_EXPLAINED
        or abs(best.fraction) < LEAST_CHANGE
        or best.gain < LEAST_GAIN * effect()
    ):
        return ""
    is_named = others and best.gain > STANDS_OUT * second.gain
    return (
        f"The focal length of {camera_in_words(best.camera) if is_named else 'one camera'} seems "
        f"to change with the distance of the {recording.object.word}, by about "
        f"{rounded(100 * abs(best.fraction), 1)} % from {rounded(best.from_m)} to "
        f"{rounded(best.to_m)} m: was its autofocus on? Switch it off, calibrate its lens with the "
        "focus that it then has, and record again."
    )


def changing_focal_of_pair(result: RefinedResult) -> str:
    """The same of two cameras; of two of a rig the rig says it."""
    if result.settings.of_rig is not None:
        return ""
    return changing_focal(result.fit, result.points_m, lambda: result.design_effect)


def _nearly_free(fit: RobustFit) -> Unknowns:
    """The unknowns of a fit with priors that hardly restrict them."""
    recording, cameras = fit.recording, fit.at
    lenses = zip(recording.labels, recording.cameras.values(), strict=True)
    settings = replace(
        fit.settings,
        lenses={it: replace(FREE_LENS, distortion=free_distortion(lens)) for it, lens in lenses},
        free_distortion=(),
        distance_sigma_m=FREE_LENGTH * recording.object.longest_m,
    )
    unknowns = unknowns_of(recording, fit.poses, settings, fit.seen.has_lengths)
    baselines, M = measured_baselines(recording, fit.settings), unknowns.M
    baselines[:, 3] = FREE_LENGTH * baselines[:, 2]
    H, g = np.zeros((len(M), len(M))), np.zeros(len(M))
    add_baselines(baselines, cameras.q, cameras.R, H, g)
    return replace(unknowns, precision=unknowns.precision + M.T @ H @ M)


def _change(
    fit: RobustFit, points_m: FloatArray, unknowns: Unknowns, freedom: int, number: int
) -> _Change:
    """The change in one camera by which the chi-square falls most."""
    cameras, used, M = fit.at, fit.used, unknowns.M
    away_m = _distances(fit, points_m, number)[used]
    order, seen = np.argsort(away_m), int(np.isfinite(away_m).sum())
    parts = np.array_split(order[:seen], min(DISTANCES, seen))
    d = np.array([np.log(away_m[part]).mean() for part in parts])
    d = np.append(d - d.mean(), 0.0)  # the last: frames that the camera does not see
    frames = [used[part] for part in (*parts, order[seen:])]
    cost, H, g = (np.array(sums) for sums in zip(*_equations(fit, points_m, frames), strict=True))
    by_focal, places = np.zeros(len(cameras.q)), lens_places(number)[:2]
    by_focal[places] = cameras.q[places]
    C = unknowns.covariance(H.sum(axis=0))
    both, of_others = M.T @ (d @ (H @ by_focal)), M.T @ g.sum(axis=0)
    # At least so much that it can be divided by: of frames that are all as far it is 0.
    information = max(float(d**2 @ (H @ by_focal @ by_focal) - both @ C @ both), LEAST_INFORMATION)
    score = float(d @ (g @ by_focal) - both @ C @ of_others)
    # The gradient of others is 0 at the minimum but for their priors.
    left = float(cost.sum() - of_others @ C @ of_others)
    fall, (near_m, far_m) = score**2 / information, away_m[order[[0, seen - 1]]].tolist()
    fraction = float(np.expm1(-score / information * np.log(far_m / near_m)))
    gain, name = fall * freedom / max(left - fall, 1e-12), [*fit.recording.cameras][number]
    return _Change(gain, fall / left, name, fraction, near_m, far_m)


def _equations(
    fit: RobustFit, points_m: FloatArray, groups: Iterable[IntArray]
) -> Iterator[tuple[float, FloatArray, FloatArray]]:
    """Cost, H (Q, Q) and g (Q,) of groups of frames, from points that have converged: of cameras
    that face each other, others have not with lengths that are nearly exact."""
    every = np.ones(len(fit.free), dtype=np.bool_)
    for group in groups:
        units = np.flatnonzero(np.isin(fit.frame_of, group))
        points, limits = points_m[units].reshape(-1, OWN), np.full(len(units), np.inf)
        yield fit.sum_at(1 / fit.scatter, limits, points, np.empty(len(units)), units, every)


def _distances(fit: RobustFit, points_m: FloatArray, number: int) -> FloatArray:
    """(f,): how far what is held is from a camera in each frame; NaN where it does not see it."""
    seen = np.isfinite(fit.seen.pixels[:, :, number, 0])
    away = np.linalg.norm(fit.poses[number].apply(points_m.reshape(-1, 3)), axis=1)
    sums = fit.by_frame(np.where(seen, away.reshape(-1, 2), 0.0).sum(axis=1))
    counts = fit.by_frame(seen.sum(axis=1))
    return np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
