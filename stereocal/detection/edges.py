"""How far the edges of an X-corner reach: where its board ends, and if a next square follows."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from stereocal.rig.compiled import FloatArray, compiled, internal

GreyImage = npt.NDArray[np.float32]

LONG = 6.0
"""Arms so many blurs long tell nothing more."""
ONE_LONG = 0.68
"""Quality where one arm seems longer than its opposite: the bar or something behind the board goes
on along that edge. Less than what is sure (`refusals.SURE_QUALITY`)."""


@compiled
def arm_quality(arms: FloatArray, cut: int, blur: float) -> float:
    """0 to 1: how much four arms look like those of one sharp board; cut ones as if whole."""
    best, worst, shortest = 0.0, 1.0, math.inf
    for pair in (0, 2):
        first, second = arms[pair], arms[pair + 1]
        if cut >> pair & 1:
            first = max(first, second)
        if cut >> pair & 2:
            second = max(first, second)
        shorter = min(first, second)
        even = math.sqrt(shorter / max(first, second))
        best, worst = max(best, even), min(worst, even)
        shortest = min(shortest, shorter)
    return best * max(worst, ONE_LONG) * min(1.0, shortest / (LONG * blur))


@internal
def _sample(image: GreyImage, x: float, y: float) -> float:
    """Grey level between the pixels; NaN outside the image."""
    height, width = image.shape
    if not (0.0 <= x <= width - 1.0 and 0.0 <= y <= height - 1.0):
        return math.nan
    column, row = min(int(x), width - 2), min(int(y), height - 2)
    fx, fy = x - column, y - row
    above = image[row, column] * (1.0 - fx) + image[row, column + 1] * fx
    below = image[row + 1, column] * (1.0 - fx) + image[row + 1, column + 1] * fx
    grey: float = above * (1.0 - fy) + below * fy
    return grey


@internal
def _profile(
    image: GreyImage,
    start: FloatArray,
    along: FloatArray,
    side: FloatArray,
    step: float,
    seen: FloatArray,
    expected: FloatArray,
) -> int:
    """Difference of the grey levels on both sides of a half edge, every `step`, per contrast.

    Fills what is seen and what a crossing of endless edges would show; both arrays start half a
    running mean before the first distance. Returns how many lie in the image.
    """
    aside = math.hypot(side[0], side[1])
    for i in range(seen.size):
        t = start[3] + i * step
        x, y = start[0] + t * along[0], start[1] + t * along[1]
        total, hoped = 0.0, 0.0
        for j in range(3):
            w = 0.75 + 0.25 * j
            total += _sample(image, x + w * side[0], y + w * side[1])
            total -= _sample(image, x - w * side[0], y - w * side[1])
            hoped += math.erf(w * aside / start[4])
        if math.isnan(total):
            return i
        seen[i] = total / (3.0 * start[2])
        expected[i] = hoped / 3.0 * math.erf(max(t, 0.0) / start[4])
    return seen.size


@internal
def _turned(seen: FloatArray) -> bool:
    """Whether the difference is evenly the other way round: the next square of a chessboard."""
    if not seen.size:
        return False
    mean, square = 0.0, 0.0
    for value in seen:
        mean += value / seen.size
        square += value * value / seen.size
    return abs(mean + 1.0) < 0.35 and square - mean * mean < 0.35**2


@internal
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
    seen = np.empty(int(1.9 * length / step) + smooth)
    expected = np.empty(seen.size)
    first = start[3]
    start[3] -= (smooth // 2) * step
    last = _profile(image, start, along, side, step, seen, expected)
    total, hoped = 0.0, 0.0
    for i in range(last):
        total += seen[i]
        hoped += expected[i]
        if i >= smooth:
            total -= seen[i - smooth]
            hoped -= expected[i - smooth]
        end = first + (i - smooth + 1) * step
        if end > length:
            return math.inf, False, False
        if i >= smooth - 1 and total < 0.5 * hoped:
            low = min(last, max(0, math.ceil((1.2 * end - start[3]) / step)))
            high = min(last, max(low, math.ceil((1.8 * end - start[3]) / step)))
            return end, _turned(seen[low:high]), False
    if last < seen.size:
        return start[3] + last * step, False, True
    return math.inf, False, False


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
    first edge, then the second), along how many a next square follows, and the bits of those that
    the image cuts.
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
