"""Follow the four half edges of an X-corner, its arms, to where its board ends."""

import math

import numpy as np

from stereocal.detection.intensity import GreyImage
from stereocal.rig.compiled import compiled
from stereocal.system.array_types import FloatArray

LONG_ARM = 6.0
"""Length in blurs beyond which a longer arm does not increase the quality."""
STEPS, SMOOTH, AHEAD = 120.0, 0.08, (1.2, 1.8)
"""Samples along the longest arm, at least 0.5 px apart; the part of the first distance over which
their difference is averaged, at least 2 px; and where, in lengths of the arm, the next square is
looked for."""
SQUARE_SPREAD = 0.35
"""Largest deviation of the difference along the next square, from -1 and in itself."""
UNEQUAL_ARMS = 0.68
"""Least factor for opposite arms of different lengths, which the bar or something in the background
can cause by extending an edge; below `checks.CERTAIN_QUALITY`."""


@compiled
def arm_quality(arms: FloatArray, cut: int, blur: float) -> float:
    """0 to 1: how well four arms correspond to one sharp board.

    Args:
        arms: (4,): lengths in px, two of the first edge, then two of the second.
        cut: bits of the arms that the image border cuts; each counts as long as its opposite.
        blur: in px.
    """
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
    return best * max(worst, UNEQUAL_ARMS) * min(1.0, shortest / (LONG_ARM * blur))


@compiled
def _sample(image: GreyImage, x: float, y: float) -> float:
    """Grey level by bilinear interpolation; NaN outside the image."""
    height, width = image.shape
    if not (0.0 <= x <= width - 1.0 and 0.0 <= y <= height - 1.0):
        return math.nan
    column, row = min(int(x), width - 2), min(int(y), height - 2)
    fx, fy = x - column, y - row
    above = image[row, column] * (1.0 - fx) + image[row, column + 1] * fx
    below = image[row + 1, column] * (1.0 - fx) + image[row + 1, column + 1] * fx
    grey: float = above * (1.0 - fy) + below * fy
    return grey


@compiled
def _profile(
    image: GreyImage,
    start: FloatArray,
    along: FloatArray,
    side: FloatArray,
    step: float,
    seen: FloatArray,
    expected: FloatArray,
) -> int:
    """Write the difference of the grey levels on both sides of an arm, relative to the contrast,
    and that expected for infinite edges, at intervals of `step`; return how many are in the image.
    """
    aside = math.hypot(side[0], side[1])
    for i in range(seen.size):
        t = start[3] + i * step
        x, y = start[0] + t * along[0], start[1] + t * along[1]
        total, model = 0.0, 0.0
        for j in range(3):
            w = 0.75 + 0.25 * j
            total += _sample(image, x + w * side[0], y + w * side[1])
            total -= _sample(image, x - w * side[0], y - w * side[1])
            model += math.erf(w * aside / start[4])
        if math.isnan(total):
            return i
        seen[i] = total / (3.0 * start[2])
        expected[i] = model / 3.0 * math.erf(max(t, 0.0) / start[4])
    return seen.size


@compiled
def _is_inverted(seen: FloatArray) -> bool:
    """Whether the difference is uniformly inverted, as along the next square of a chessboard."""
    mean, square = 0.0, 0.0
    for value in seen:
        mean += value / seen.size
        square += value * value / seen.size
    return abs(mean + 1.0) < SQUARE_SPREAD and square - mean * mean < SQUARE_SPREAD**2


@compiled
def _arm(
    image: GreyImage, start: FloatArray, along: FloatArray, side: FloatArray, length: float
) -> tuple[float, bool, bool]:
    """The distance at which the difference on both sides of an arm falls below half of the expected
    one, or infinity; whether it is inverted between 1.2 and 1.8 times that distance; whether the
    image ends.

    Args:
        start: (5,): u, v, the difference of the grey levels on both sides far from the crossing,
            the first distance, and the blur along the edge, px.
        along, side: (2,): direction of the arm, and step from the edge into a square.
        length: maximum distance, px.
    """
    step = max(0.5, length / STEPS)
    smooth = max(1, int(2.0 / step), int(SMOOTH * start[3] / step))
    seen = np.empty(int(1.9 * length / step) + smooth)  # a little more than AHEAD
    expected = np.empty(seen.size)
    first = start[3]
    start[3] -= (smooth // 2) * step
    last = _profile(image, start, along, side, step, seen, expected)
    total, model = 0.0, 0.0
    for i in range(last):
        total += seen[i]
        model += expected[i]
        if i >= smooth:
            total -= seen[i - smooth]
            model -= expected[i - smooth]
        end = first + (i - smooth + 1) * step
        if end > length:
            return math.inf, False, False
        if i >= smooth - 1 and total < 0.5 * model:
            low = min(last, max(0, math.ceil((AHEAD[0] * end - start[3]) / step)))
            high = min(last, max(low, math.ceil((AHEAD[1] * end - start[3]) / step)))
            return end, _is_inverted(seen[low:high]), False
    if last < seen.size:
        return start[3] + last * step, False, True
    return math.inf, False, False


@compiled
def follow(
    image: GreyImage, p: FloatArray, half: FloatArray, reach: float
) -> tuple[FloatArray, int, int]:
    """Find where the board of an X-corner ends, and whether another square follows.

    Args:
        p: (13,), the parameters of `corner_model`.
        half: (2,): half size of the fitted window along the two edges, px.
        reach: maximum length of an arm, in half sizes of the window.

    Returns:
        The lengths of the four arms (forward and back along the first edge, then the second;
        infinite beyond the reach), the number of arms followed by another square, and the bits of
        the arms that the image border cuts.
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
    start[4] = max(blur, 0.3) * math.sqrt(2.0) / sine  # erf(t / it) along the other edge
    for i in range(4):
        e, o = i // 2, 1 - i // 2
        forward = 1.0 - 2.0 * (i % 2)
        # Far enough from the edge for 97 % of the contrast (2.2 blurs), within the board.
        offset = max(1.0, min(max(2.0, 2.2 * blur) / sine, 0.8 * half[o]))
        # The bright side follows from F being positive where both distances have the same sign.
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
