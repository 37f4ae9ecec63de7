"""Whether a camera moved during a recording.

The recording is divided into blocks of frames. In the fit of all frames, linear at its end, each
block gets a pose of the camera of its own. One step of the pose, at the best block, is compared
with what is left between the blocks (an F ratio): whatever else differs between blocks is no
movement. Noise does, errors that neighbouring frames share, lenses that are not as their model
where the object goes elsewhere, and a camera that drifts; the step must also explain more than an
even drift would.

A camera that was turned far leaves the frames before it or after it out of a robust fit. A part of
which nearly all frames are left out, and that fits by itself, is such a one; the blocks are then
linear at the ends of the fits of both parts.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.special import fdtrc

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.robust import RobustFit
from stereocal.fit.least_squares.small_steps import step_between
from stereocal.fit.least_squares.unknowns import inverse_of
from stereocal.fit.least_squares.views import EACH, LENS
from stereocal.system.array_types import FloatArray, IntArray
from stereocal.system.numbers import rounded

BLOCKS, OF_BLOCK, OF_SIDE = 16, 2, 2
"""Most blocks, least bars of one, and least blocks before a step and after it."""
FEWEST, FEWEST_UNITS = 4, 10
"""Of a part: frames, and bars or parts of boards."""
SEEMS, LEAST_RATIO, BY_CHANCE = 8.0, 25.0, 1e-6
"""Least F ratios of a step with which both parts are fitted, and of a movement in these fits; and
the largest probability of one as large by chance. None of 144 parts of a real recording that stood
still has such a one; with a camera turned by 0.1 degrees 13 of 54 do, by 0.2 degrees 41."""
LEFT_OUT = 3.0
"""Standard errors by which more frames are left out after a step than before it, or the other way
round."""
OF_PART, BY_ITSELF, NOISE = 0.5, 0.2, 1.5
"""Share of the frames of a part that are left out of the whole, largest share by itself, and
largest noise of its fit over that of the whole."""
APART = 1.3
"""How many times more the moved camera must explain than any other."""
FAR = 5.0
"""Noise of the fit of all frames over that of both parts, from which on it is of no use."""
SMALLEST = 1e-10
"""Of eigenvalues, over the largest."""

Fitted = Callable[[IntArray], RobustFit | None]
"""The fit of some frames, by their numbers; None if it fails."""


@dataclass(frozen=True)
class Movement:
    """A movement of a camera among the frames."""

    last: int
    """The frame before it."""
    first: int
    """The frame after it."""
    cameras: tuple[int, ...]
    """The number of the camera; of all that it may be, if the points do not tell which."""
    change: FloatArray
    """(6,): of its pose: x' = exp(turn) R x + T + shift."""
    is_far: bool
    """Whether no fit of all frames is worth anything."""

    @property
    def in_words(self) -> str:
        """How far it is."""
        turn, shift = (float(np.linalg.norm(part)) for part in np.split(self.change, 2))
        return f"{rounded(float(np.degrees(turn)))} degrees and {rounded(1000.0 * shift)} mm"


class MovedError(StereocalError):
    """A camera moved so far that no calibration fits all frames."""


class _Step(NamedTuple):
    """A step of the pose of a camera."""

    explained: float
    """Its chi-square."""
    ratio: float
    """The F ratio, 0 where it may be chance."""
    camera: int
    start: int
    """The first block after it."""
    change: FloatArray
    """(6,): as of `Movement`."""


def movement(fit: RobustFit, fitted: Fitted) -> Movement | None:
    """The movement of a camera among the frames of a fit, if there is one.

    Args:
        fit: at its end.
        fitted: its frames in parts.
    """
    for steps, parts in _candidates(fit, fitted):
        tested = {step.camera: step for step in _steps(fit, parts)}
        if max((step.ratio for step in tested.values()), default=0.0) > LEAST_RATIO:
            named = {step.camera: step.explained for step in steps}
            far = not named or fit.sigma_px > FAR * max(part.sigma_px for part in parts)
            evidence = {camera: step.ratio for camera, step in tested.items()} if far else named
            ranked = sorted(evidence, key=lambda camera: -evidence[camera])
            cameras = tuple(
                camera for camera in ranked if APART * evidence[camera] > evidence[ranked[0]]
            )
            first = _first_after(fit, parts)
            last = int(fit.frames[fit.frames < first][-1])
            return Movement(last, first, cameras, tested[ranked[0]].change, far)
    return None


def _candidates(fit: RobustFit, fitted: Fitted) -> Iterator[tuple[list[_Step], list[RobustFit]]]:
    """The steps of the cameras in the fit of all frames, and the fits of both parts; and the parts
    of which one is left out of that fit, and is therefore in no step."""
    if (steps := _steps(fit, [fit])) and steps[0].ratio > SEEMS:
        first = int(fit.frames[_blocks(fit)[steps[0].start][0]])
        if len(parts := _parts(fit, fitted, first)) == 2:
            yield steps, parts
    if first := _left_out_from(fit):
        parts = _parts(fit, fitted, first)
        if _left_out_as_one(fit, parts):
            yield [], parts


def _steps(fit: RobustFit, parts: Sequence[RobustFit]) -> list[_Step]:
    """The best step of each camera, the one that explains most first; none of few frames.

    Args:
        parts: the fit itself, or those of the frames before a step and of those after it.
    """
    blocks = [(part, block) for part in parts for block in _blocks(part, len(parts))]
    starts = range(OF_SIDE, len(blocks) - OF_SIDE + 1)
    if len(parts) > 1:
        starts = range(len(_blocks(parts[0], 2)), len(_blocks(parts[0], 2)) + 1)
    if len(blocks) < 2 * OF_SIDE:
        return []
    H, g = map(
        np.array, zip(*(_equations(fit, part, block) for part, block in blocks), strict=True)
    )
    M = fit.unknowns.M
    C = inverse_of(M.T @ H.sum(axis=0) @ M + fit.unknowns.precision, SMALLEST)
    step = C @ (M.T @ g.sum(axis=0) + fit.unknowns.precision @ fit.p)
    freedom = sum(int(part.degrees_of_freedom[block].sum()) for part, block in blocks)
    cost = sum(float(part.chi_squares[block].sum()) for part, block in blocks)
    steps = list[_Step]()
    for camera in range(len(fit.seen.lenses)):
        pose = slice(EACH * camera, EACH * camera + LENS)
        by_all = M.T @ H[:, :, pose]
        K = -np.einsum("aki,kl,blj->aibj", by_all, C, by_all)
        K[np.arange(len(H)), :, np.arange(len(H))] += H[:, pose, pose]
        steps.append(
            _best_step(K, g[:, pose] - step @ by_all, starts, (freedom - len(fit.p), cost), camera)
        )
    return sorted(steps, key=lambda step: -step.explained)


def _best_step(
    K: FloatArray, g: FloatArray, starts: Sequence[int], left: tuple[int, float], camera: int
) -> _Step:
    """The step of a camera that explains most.

    Args:
        K: (b, 6, b, 6): normal matrix of the poses of the blocks, all other unknowns eliminated.
        g: (b, 6): the gradient.
        starts: blocks from which on it may be; one, if both parts were fitted by themselves.
        left: degrees of freedom, and chi-square.
    """
    index = np.arange(len(g))
    after = [(index[:, None] >= start).astype(np.float64) for start in starts]
    tried = [
        (*_explained(K, g, weights), start) for weights, start in zip(after, starts, strict=True)
    ]
    explained, size, change, start = max(tried, key=lambda trial: trial[0])
    in_all, of_all, _ = _explained(K, g, np.eye(len(g))[:, 1:])
    of_drift, _, _ = _explained(K, g, (index - index.mean())[:, None])
    freedom, cost = left
    noise = (cost - explained * (len(starts) > 1)) / max(freedom, 1)
    if size and of_all > size and explained > of_drift:
        between = (in_all - explained) / (of_all - size)
        ratio = explained / size / max(noise, between)
        if len(starts) * fdtrc(size, of_all - size, ratio) < BY_CHANCE:
            return _Step(explained, ratio, camera, start, change)
    return _Step(explained, 0.0, camera, start, change)


def _explained(K: FloatArray, g: FloatArray, weights: FloatArray) -> tuple[float, int, FloatArray]:
    """The chi-square that changes of the poses of the blocks explain, how many values they have,
    and these.

    Args:
        weights: (b, m): how much of each of m changes (6,) each block has.
    """
    b = (weights.T @ g).ravel()
    A = np.einsum("am,aibj,bn->minj", weights, K, weights).reshape(len(b), len(b))
    inverse = inverse_of(A, SMALLEST)
    return float(b @ inverse @ b), int(np.linalg.matrix_rank(inverse)), -inverse @ b


def _blocks(part: RobustFit, parts: int = 1) -> list[IntArray]:
    """The used frames of one of so many parts in blocks, as indices into its frames."""
    used, least = part.used, 1 if part.seen.has_parts else OF_BLOCK
    return np.array_split(used, max(min(BLOCKS // parts, len(used) // least), 1))


def _equations(fit: RobustFit, part: RobustFit, block: IntArray) -> tuple[FloatArray, FloatArray]:
    """H (Q, Q) and g (Q,) of some frames of a part, at the whole fit."""
    (H,), (g,), _ = part.equations([block])
    return (H, g) if part is fit else (H, g - H @ step_between(part.at, fit.at))


def _left_out_from(fit: RobustFit) -> int:
    """The frame at which the share of the frames that are left out changes most; 0 for chance."""
    starts = np.arange(FEWEST, len(fit.frames) - FEWEST + 1)
    out, total = np.cumsum(fit.outlying), len(fit.frames)
    share = out[-1] / total
    if not share or not len(starts):
        return 0
    apart = np.abs(out[starts - 1] - starts * share)
    apart /= np.sqrt(starts * (total - starts) * share * max(1.0 - share, 1.0 / total) / total)
    return int(fit.frames[starts[apart.argmax()]]) if apart.max() > LEFT_OUT else 0


def _left_out_as_one(fit: RobustFit, parts: Sequence[RobustFit]) -> bool:
    """Whether nearly all frames of a part are left out of the whole, and fit as well by themselves
    as the others do."""
    return any(
        fit.outlying[np.isin(fit.frames, part.frames)].mean() > OF_PART
        and part.outlying.mean() < BY_ITSELF
        and part.sigma_px < NOISE * fit.sigma_px
        and len(part.seen.frame_of) >= FEWEST_UNITS
        for part in parts
    )


def _parts(fit: RobustFit, fitted: Fitted, first: int) -> list[RobustFit]:
    """Fits of the frames before one and of those from it on; empty where one fails."""
    both = fit.frames[fit.frames < first], fit.frames[fit.frames >= first]
    fits = [part for part in map(fitted, both) if part is not None]
    return fits if len(fits) == 2 else []


def _first_after(fit: RobustFit, parts: Sequence[RobustFit]) -> int:
    """The frame from which on the second of two fits explains the frames best."""
    before, after = (np.minimum(fit.chi_squares_with(part), fit.limit) for part in parts)
    gain = np.cumsum((before - after)[::-1])[::-1]
    return int(fit.frames[1 + gain[1:].argmax()])
