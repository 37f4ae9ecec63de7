"""One X-corner of a photograph: how far its board reaches, and where exactly its centre is.

The fit (`corner_model`) starts in a small window. Along the four half edges the contrast between
the two sides tells where the board ends; the window grows with the edges that are found straight,
up to most of the board, and never takes in its outer border.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereocal.compiled import FloatArray, compiled
from stereocal.corner_model import (
    ALL,
    CORE,
    CURVATURE_SIGMA,
    GRADIENT_SIGMA,
    minimise,
    spread,
    window,
)

GreyImage = npt.NDArray[np.float32]

INSIDE = 0.85
"""The window reaches so far along each arm, less one blur: boards in perspective are no
parallelograms, and their border is blurred too."""
SMALLEST_HALF_WINDOW = 2.5
GROWTH = 3.0
PIXELS_WHILE_GROWING = 1500
SMALLEST_SINE = 0.35
"""Edges closer than 20 degrees: a board tilted by more than 70."""
FARTHEST = 30.0
WORST_ARMS = 0.4
ROUNDS = 30
MISFIT = 0.06
"""Boards have 0.00 to 0.03, pickets and leaves 0.05 to 0.15."""
LONG = 6.0
"""Arms so many blurs long tell nothing more."""
SHARP = 1.3
"""Below this blur, in px, the model is averaged over each pixel."""


@dataclass(frozen=True, eq=False)
class Corner:
    """A fitted X-corner. Lengths in px, brightness in grey levels of the photograph."""

    centre: FloatArray
    """(2,): u, v."""
    covariance: FloatArray
    """(2, 2), px^2."""
    directions: FloatArray
    """(2, 2): unit vectors along the two edges."""
    arms: FloatArray
    """(4,): how far the edges reach: forward and back along the first, then along the second."""
    flips: int
    """Along so many arms a next square follows in the opposite order: a larger chessboard."""
    cut: int
    """Bit i is set where arm i ends at the border of the image."""
    blur: float
    contrast: float
    """White less black."""
    black: float
    white: float
    residual: float
    """Root mean square of what the fit leaves."""
    misfit: float
    """What the fit leaves that is no noise, root mean square, per contrast."""

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the centre, the mean over both directions."""
        return math.sqrt(0.5 * float(np.trace(self.covariance)))

    @property
    def quality(self) -> float:
        """0 to 1: less where the fit leaves a pattern, and where the arms differ or are short.

        Saddles of leaves, fences and clouds are curved and soft: most have less than 0.6.
        """
        return arm_quality(self.arms, self.cut, self.blur) * math.exp(
            -0.5 * (self.misfit / MISFIT) ** 2
        )

    @property
    def lengths(self) -> FloatArray:
        """(2,): lengths of the board along its two edges; the shorter arm counts twice."""
        return np.array([2.0 * min(self.arms[:2]), 2.0 * min(self.arms[2:])])

    @property
    def board_px(self) -> float:
        """Size of the board: the mean of its two lengths."""
        return float(self.lengths.mean())


@compiled
def arm_quality(arms: FloatArray, cut: int, blur: float) -> float:
    """0 to 1: how much four arms look like those of one sharp board; cut ones (bits) as if whole."""
    quality, shortest = 1.0, math.inf
    for pair in (0, 2):
        first, second = arms[pair], arms[pair + 1]
        if cut >> pair & 1:
            first = max(first, second)
        if cut >> pair & 2:
            second = max(first, second)
        shorter = min(first, second)
        quality *= math.sqrt(shorter / max(first, second))
        shortest = min(shortest, shorter)
    return quality * min(1.0, shortest / (LONG * blur))


@compiled
def _sample(image: GreyImage, x: float, y: float) -> float:
    """Grey level between the pixels; NaN outside the image."""
    height, width = image.shape
    if not (0.0 <= x <= width - 1.0 and 0.0 <= y <= height - 1.0):
        return math.nan
    column, row = min(int(x), width - 2), min(int(y), height - 2)
    fx, fy = x - column, y - row
    above = image[row, column] * (1.0 - fx) + image[row, column + 1] * fx
    below = image[row + 1, column] * (1.0 - fx) + image[row + 1, column + 1] * fx
    return above * (1.0 - fy) + below * fy


@compiled
def _arm(
    image: GreyImage, start: FloatArray, along: FloatArray, side: FloatArray, length: float
) -> tuple[float, bool, bool]:
    """Follow one half edge.

    Args:
        start: (5,): u, v, the difference of the grey levels on both sides far from the crossing,
            the first distance, and the blur along the edge, px.
        along: (2,), the direction to go.
        side: (2,), the step from the edge into a square.
        length: how far to look.

    Returns where the difference falls below half of what a crossing has there (infinite where it
    does not), whether the same difference, the other way round, follows from 1.2 to 1.8 times as
    far, and whether the image ends there.
    """
    step = max(0.5, length / 120.0)
    smooth = max(1, int(2.0 / step), int(0.08 * start[3] / step))
    count = int(1.9 * length / step) + smooth
    profile, expected = np.empty(count), np.empty(count)
    last = count
    aside = math.hypot(side[0], side[1])
    for i in range(count):
        t = start[3] + (i - smooth // 2) * step
        x, y = start[0] + t * along[0], start[1] + t * along[1]
        total, hoped = 0.0, 0.0
        for j in range(3):
            w = 0.75 + 0.25 * j
            total += _sample(image, x + w * side[0], y + w * side[1])
            total -= _sample(image, x - w * side[0], y - w * side[1])
            hoped += math.erf(w * aside / start[4])
        profile[i] = total / (3.0 * start[2])
        expected[i] = hoped / 3.0 * math.erf(max(t, 0.0) / start[4])
        if math.isnan(total):
            last = i
            break
    end, total, hoped = -1, 0.0, 0.0
    for i in range(last):
        total += profile[i]
        hoped += expected[i]
        if i >= smooth:
            total -= profile[i - smooth]
            hoped -= expected[i - smooth]
        t = start[3] + (i - smooth + 1) * step
        if t > length:
            return math.inf, False, False
        if i >= smooth - 1 and total < 0.5 * hoped:
            end = i - smooth + 1
            break
    if end < 0:
        if last < count:
            return start[3] + last * step, False, True
        return math.inf, False, False
    distance = start[3] + end * step
    beyond, square, n = 0.0, 0.0, 0
    for i in range(end, last):
        t = start[3] + i * step
        if 1.2 * distance < t < 1.8 * distance:
            beyond += profile[i]
            square += profile[i] ** 2
            n += 1
    if n == 0:
        return distance, False, False
    mean = beyond / n
    return distance, abs(mean + 1.0) < 0.35 and square / n - mean * mean < 0.35**2, False


@compiled
def follow(
    image: GreyImage, p: FloatArray, half: FloatArray, reach: float
) -> tuple[FloatArray, int, int]:
    """Where the board of an X-corner ends.

    Args:
        image: (h, w).
        p: (13,), the parameters of `corner_model`.
        half: (2,): the fitted window reaches so far along the two edges, px.
        reach: look so many windows far.

    Returns the lengths of the four arms (infinite beyond the reach; forward and back along the
    first edge, then the second), along how many a next square follows, and the bits of those that the image cuts.
    """
    arms, flips, cut = np.empty(4), 0, 0
    along, normal = np.empty((2, 2)), np.empty((2, 2))
    for e in range(2):
        normal[e, 0], normal[e, 1] = math.cos(p[2 + e]), math.sin(p[2 + e])
        along[e, 0], along[e, 1] = -normal[e, 1], normal[e, 0]
    blur = math.exp(p[4])
    sine = abs(math.sin(p[2] - p[3]))
    start = np.empty(5)
    start[0], start[1] = p[0], p[1]
    start[4] = max(blur, 0.3) * math.sqrt(2.0) / sine
    for i in range(4):
        e, o = i // 2, 1 - i // 2
        forward = 1.0 - 2.0 * (i % 2)
        offset = max(1.0, min(max(2.0, 2.2 * blur) / sine, 0.8 * half[o]))
        # F is positive where both distances have one sign: which side is bright follows.
        aside = along[o, 0] * normal[e, 0] + along[o, 1] * normal[e, 1]
        ahead = along[e, 0] * normal[o, 0] + along[e, 1] * normal[o, 1]
        start[2] = math.copysign(2.0 * p[6], aside * ahead * forward * p[6])
        start[3] = max(1.0, min(2.0 * blur / sine, 0.8 * half[e]))
        arms[i], turned, ended = _arm(
            image, start, forward * along[e], offset * along[o], reach * half[e]
        )
        flips += int(turned)
        cut |= int(ended) << i
    return arms, flips, cut


def _directions(p: FloatArray) -> FloatArray:
    """(2, 2): unit vectors along the edges; the normals are p[2] and p[3]."""
    return np.array([[-math.sin(p[2]), math.cos(p[2])], [-math.sin(p[3]), math.cos(p[3])]])


def _fit(
    image: GreyImage,
    p: FloatArray,
    half: FloatArray,
    noise: float,
    size: int,
    stride: int,
    samples: int,
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Fit in one window: pixels, parameters, penalty, and whether it converged."""
    pixels = window(image, p[0], p[1], _directions(p), half, stride)
    penalty = np.zeros(ALL)
    radius = float(half.max())
    penalty[7:9] = noise / CURVATURE_SIGMA**2
    penalty[9:] = noise / (GRADIENT_SIGMA * p[6]) ** 2
    fitted = p.copy()
    if len(pixels) <= size + 4:
        return pixels, fitted, penalty, False
    _, converged = minimise(pixels, fitted, size, radius, samples, penalty, ROUNDS)
    return pixels, fitted, penalty, converged


@compiled
def plausible(p: FloatArray, start: FloatArray, reach: float) -> bool:
    """Whether a fit stayed at its corner and kept two different edges and a blur that can be."""
    moved = math.hypot(p[0] - start[0], p[1] - start[1])
    return (
        math.isfinite(p[:CORE].sum())
        and moved < reach
        and abs(math.sin(p[2] - p[3])) > SMALLEST_SINE
        and -3.0 < p[4] < math.log(2.0 * max(reach, 1.0))
        and p[6] * start[6] > 0.0
    )


def fit_corner(
    image: GreyImage, start: FloatArray, half: float, quantum: float, gain: float = 1.0
) -> Corner | None:
    """Fit the X-corner near a start.

    Args:
        image: (h, w), grey levels times `gain`.
        start: (13,), the first seven parameters of `corner_model` near their values.
        half: px; the first window reaches so far from the centre along both edges.
        quantum: step of the numbers in `image`: the gain for a photograph of integers, or 0.
        gain: the result is given in grey levels.

    Returns None where the fit finds no crossing of two edges.
    """
    p = start.copy()
    reach = np.array([half, half])
    noise = max(quantum**2 / 12.0, (0.05 * p[6]) ** 2)
    _, p, _, _ = _fit(image, p, reach, noise, CORE, 1, 0)
    if not plausible(p, start, half):
        return None
    arms, flips, cut = np.full(4, np.inf), 0, 0
    for _ in range(7):
        arms, flips, cut = follow(image, p, reach, GROWTH)
        blur = math.exp(p[4])
        ends = np.array([min(arms[:2]), min(arms[2:])])
        wanted = np.maximum(INSIDE * ends - blur, SMALLEST_HALF_WINDOW)
        grown = np.minimum(wanted, GROWTH * reach)
        done = bool(np.isfinite(ends).all() and (np.abs(grown / reach - 1.0) < 0.1).all())
        reach = grown
        stride = max(1, round(math.sqrt(4.0 * reach[0] * reach[1] / PIXELS_WHILE_GROWING)))
        size = CORE if max(reach) < 8 else ALL
        _, fitted, _, _ = _fit(image, p, reach, noise, size, stride, 0)
        if not plausible(fitted, p, float(min(reach))):
            return None
        p = fitted
        if done:
            break
    if cut:
        # A board at the border has a small window, from which its other arms reach far.
        arms, flips, cut = follow(image, p, reach, FARTHEST)
    if not np.isfinite(arms).all() or arm_quality(arms, cut, math.exp(p[4])) < WORST_ARMS:
        return None
    return _final(image, p, reach, noise, (quantum, gain), (arms, flips, cut))


def _final(
    image: GreyImage,
    p: FloatArray,
    half: FloatArray,
    noise: float,
    scale: tuple[float, float],
    ends: tuple[FloatArray, int, int],
) -> Corner | None:
    """The fit of all pixels of the last window, and what is said of it."""
    quantum, gain = scale
    smallest = max(quantum**2 / 12.0, (1e-5 * p[6]) ** 2)
    radius = float(half.max())
    for _ in range(2):
        samples = 4 if math.exp(p[4]) < SHARP else 1
        pixels, fitted, penalty, converged = _fit(image, p, half, noise, ALL, 1, samples)
        if not converged or not plausible(fitted, p, float(min(half))):
            return None
        p = fitted
        found = spread(pixels, p, radius, samples, penalty)
        noise = max(found[3], smallest)
    variance = max(found[3], found[4], smallest)
    if not np.isfinite(found).all():
        return None
    covariance = variance * np.array([[found[0], found[1]], [found[1], found[2]]])
    contrast = 2.0 * abs(p[6])
    # Chance gives the products of n residuals of pure noise a spread of 1 / sqrt(n).
    pattern = float(found[5] - 2.0 * found[3] / math.sqrt(len(pixels)))
    return Corner(
        centre=p[:2].copy(),
        covariance=covariance,
        directions=_directions(p),
        arms=ends[0],
        flips=ends[1],
        cut=ends[2],
        blur=math.exp(p[4]),
        contrast=contrast / gain,
        black=float(p[5] - contrast / 2) / gain,
        white=float(p[5] + contrast / 2) / gain,
        residual=math.sqrt(found[3]) / gain,
        misfit=math.sqrt(max(0.0, pattern)) / float(contrast),
    )
