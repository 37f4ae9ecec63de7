"""Find candidates for X-corners: saddle points of the intensity, at several scales.

A saddle point has det(Hessian) < 0 (Beaudet, 1978). The intensity on a ring around it must change
sign four times and be equal on opposite sides. The remaining points are fitted with `corner_model`
in a small window, which excludes most structures of leaves, fences and windows.
"""

import math
from collections.abc import Iterator

import cv2
import numpy as np

from stereocal.detection.corner_model import ALL, CORE
from stereocal.detection.edges import arm_quality, follow
from stereocal.detection.fit import plausible, window
from stereocal.detection.intensity import GreyImage
from stereocal.detection.solver import fit_parameters
from stereocal.rig.compiled import compiled
from stereocal.system.array_types import FloatArray

LEVELS = 5
"""Levels of the image pyramid, each half the size; the last detects edges with 20 px of blur."""
SMALLEST_SIDE = 16
"""Smallest side of a level, px."""
SMOOTHING = 1.1
WEAKEST = 1.0
"""Least root of -det(Hessian), grey levels per px^2; a contrast of 40 with a blur of 3 px has 3 at
its strongest level."""
RING = np.array([(4, 0), (4, 2), (3, 3), (2, 4), (0, 4), (-2, 4), (-3, 3), (-4, 2)])
RING = np.vstack([RING, -RING]).astype(np.int64)
RING_ANGLES = np.unwrap(np.arctan2(RING[:, 1], RING[:, 0]).astype(np.float64))
BORDER = 5
ASYMMETRY = 0.3
"""Largest mean square difference of opposite points of the ring, over twice its variance, which
points that have nothing in common differ by."""
START_BLUR = 0.4
"""Logarithm of the blur, 1.5 px, at which fits begin."""
SMALLEST_CONTRAST = 8.0
"""Least difference of white and black, in grey levels of 255."""
HALF_WINDOW = 5.0
"""Half size of the window, px of the level."""
MAXIMUM_FITS, MAXIMUM_STARTS = 64, 400
"""Number of points to fit in each level, best correlation first. Corners of larger chessboards
count only in the second number, so that they do not displace others. In 80 photographs of the bar
with clutter, each target was among the first 24 of at least one level."""
ROUNDS, TOLERANCE_PX = 8, 0.02
FASTEST, EVERY = 0, 1  # samples of `fit_parameters`; stride of `window`
EXPLAINED = 0.6
"""Least share of the variance that the model explains; it is 0.86 for a contrast of 40 and noise of
8, and less if the window includes the border of a very small board."""
ARM_REACH = 30.0
"""Maximum length of an arm, in half windows."""
SCORE, FLIPS, LEVEL = ALL, ALL + 1, ALL + 2
COLUMNS = ALL + 3
"""Columns of a candidate: the parameters, its score, flips, and level."""


@compiled
def _saddle(image: GreyImage, y: int, strength: GreyImage) -> None:
    """Write -det(Hessian) of one row, (w,), by second differences, except at its ends."""
    for x in range(1, image.shape[1] - 1):
        xx = image[y, x + 1] - 2 * image[y, x] + image[y, x - 1]
        yy = image[y + 1, x] - 2 * image[y, x] + image[y - 1, x]
        xy = image[y + 1, x + 1] - image[y + 1, x - 1]
        xy += image[y - 1, x - 1] - image[y - 1, x + 1]
        strength[x] = xy * xy * np.float32(0.0625) - xx * yy


@compiled
def _crossings(ring: FloatArray, middle: float, edges: FloatArray) -> bool:
    """Whether a ring changes sign four times; the angles (4,) are written to `edges`."""
    n, count = ring.size, 0
    for i in range(n):
        here, ahead = ring[i] - middle, ring[(i + 1) % n] - middle
        if (here > 0) != (ahead > 0):
            if count == 4:
                return False
            turn = math.pi / 8.0 if i == n - 1 else RING_ANGLES[i + 1] - RING_ANGLES[i]
            edges[count] = RING_ANGLES[i] + turn * here / (here - ahead)
            count += 1
    return count == 4


@compiled
def _ring(image: GreyImage, x: int, y: int, ring: FloatArray, p: FloatArray) -> bool:
    """Whether a ring looks like that of an X-corner; the initial parameters are written to p.

    The ring of an X-corner crosses its middle grey level four times, and is the same after half a
    turn (`ASYMMETRY`). Each edge has the mean direction of its two crossings.

    Args:
        ring: (n,), for work.
        p: (13,), written.
    """
    n, darkest, brightest = ring.size, math.inf, -math.inf
    for i in range(n):
        ring[i] = image[y + RING[i, 1], x + RING[i, 0]]
        darkest, brightest = min(darkest, ring[i]), max(brightest, ring[i])
    middle = 0.5 * (darkest + brightest)
    if brightest - darkest < SMALLEST_CONTRAST:
        return False
    edges = np.empty(4)
    if not _crossings(ring, middle, edges):
        return False
    variance, difference = 0.0, 0.0
    for i in range(n):
        variance += (ring[i] - middle) ** 2
        difference += (ring[i] - ring[(i + n // 2) % n]) ** 2
    if difference > 2.0 * ASYMMETRY * variance:
        return False
    first = 0.5 * (edges[0] + edges[2] - math.pi)
    second = 0.5 * (edges[1] + edges[3] - math.pi)
    # Whether the ring is bright just after the first change of sign, between the two edges.
    bright = True
    for i in range(n):
        if RING_ANGLES[i] > edges[0]:
            bright = ring[i] > middle
            break
    for i in range(p.size):
        p[i] = 0.0
    p[0], p[1] = x, y
    p[2] = first - 0.5 * math.pi if bright else first + 0.5 * math.pi
    p[3] = second + 0.5 * math.pi
    p[4], p[5], p[6] = START_BLUR, middle, math.sqrt(variance / n)
    return True


@compiled
def _correlation(image: GreyImage, x: int, y: int, p: FloatArray) -> float:
    """Correlation of 9x9 pixels with a crossing whose edges are ramps of 4 px: h and k are half the
    distances from the edges, cut off at -1 and 1."""
    cos1, sin1, cos2, sin2 = math.cos(p[2]), math.sin(p[2]), math.cos(p[3]), math.sin(p[3])
    n, one, two, both, square1, square2 = 0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(-4, 5):
        for i in range(-4, 5):
            h = min(max(0.5 * (cos1 * i + sin1 * j), -1.0), 1.0)
            k = min(max(0.5 * (cos2 * i + sin2 * j), -1.0), 1.0)
            model, value = h * k, image[y + j, x + i] - p[5]
            n += 1
            one += model
            two += value
            both += model * value
            square1 += model * model
            square2 += value * value
    variance1, variance2 = square1 - one * one / n, square2 - two * two / n
    return (both - one * two / n) / math.sqrt(max(variance1 * variance2, 1e-12))


@compiled
def _starts(image: GreyImage, weakest: float) -> FloatArray:
    """(n, 14): initial parameters at the saddle points that pass the ring, and the correlation."""
    height, width = image.shape
    starts = np.empty((256, ALL + 1))
    ring = np.empty(RING.shape[0])
    rows = np.zeros((3, width), dtype=np.float32)
    n = 0
    for y in range(BORDER - 1, BORDER + 1):
        _saddle(image, y, rows[y % 3])
    for y in range(BORDER, height - BORDER):
        above, here, below = rows[(y - 1) % 3], rows[y % 3], rows[(y + 1) % 3]
        _saddle(image, y + 1, below)
        for x in range(BORDER, width - BORDER):
            s = here[x]
            if s < weakest or here[x - 1] > s or here[x + 1] > s:
                continue
            if max(above[x - 1], above[x], above[x + 1]) > s:
                continue
            if max(below[x - 1], below[x], below[x + 1]) > s:
                continue
            if _ring(image, x, y, ring, starts[n]):
                starts[n, ALL] = _correlation(image, x, y, starts[n])
                n += 1
                if n == starts.shape[0]:
                    starts = _twice_as_long(starts)
    return starts[:n]


@compiled
def _twice_as_long(starts: FloatArray) -> FloatArray:
    """numba takes 3 s to compile the assignment of a slice, with its messages about shapes."""
    larger = np.empty((2 * starts.shape[0], starts.shape[1]))
    for i in range(starts.shape[0]):
        for j in range(starts.shape[1]):
            larger[i, j] = starts[i, j]
    return larger


@compiled
def _fit_starts(level: GreyImage, starts: FloatArray, scores: FloatArray) -> None:
    """Fit each start in a small window, in place, and write its score and its number of flips to
    `scores` (n, 2): 0 for those after the first `MAXIMUM_FITS`, not counting larger chessboards.
    """
    along, half = np.empty((2, 2)), np.full(2, HALF_WINDOW)
    penalty, before = np.zeros(ALL), np.empty(ALL)
    left = MAXIMUM_FITS
    # Plain numbers: for constants, numba would compile what is called again.
    size, samples, stride, rounds = int(CORE), int(FASTEST), int(EVERY), int(ROUNDS)
    for i in range(starts.shape[0]):
        if left == 0:
            break
        left -= 1
        p = starts[i]
        for a in range(ALL):
            before[a] = p[a]
        along[0, 0], along[0, 1] = -math.sin(p[2]), math.cos(p[2])
        along[1, 0], along[1, 1] = -math.sin(p[3]), math.cos(p[3])
        pixels = window(level, p[0], p[1], along, half, stride)
        if pixels.shape[0] < 3 * CORE:
            continue
        cost, _ = fit_parameters(
            pixels, p, size, HALF_WINDOW, samples, penalty, rounds, TOLERANCE_PX
        )
        if not plausible(p, before, 3.0) or 2.0 * abs(p[6]) < SMALLEST_CONTRAST:
            continue
        explained = 1.0 - cost / max(np.var(pixels[:, 2]) * pixels.shape[0], 1e-9)
        if explained < EXPLAINED:
            continue
        arms, flips, cut = follow(level, p, half, ARM_REACH)
        for a in range(4):
            arms[a] = min(arms[a], ARM_REACH * HALF_WINDOW)
        scores[i, 0], scores[i, 1] = explained * arm_quality(arms, cut, math.exp(p[4])), flips
        left += int(flips >= 2)


def candidates(image: GreyImage) -> FloatArray:
    """Find possible X-corners in a photograph (h, w) with grey levels from 0 to about 255.

    Returns:
        (n, 16), best first: the parameters of `corner_model` in px of the photograph, the score,
        the number of arms followed by another square, and the level of the pyramid.
    """
    by_level = []
    for depth, level in enumerate(_pyramid(image)):
        rows = _of_level(level, depth)
        rows[:, :2] = (rows[:, :2] + 0.5) * 2.0**depth - 0.5
        rows[:, 4] += math.log(2.0**depth)
        rows[:, 7:9] /= 2.0**depth
        by_level.append(rows)
    together = np.concatenate(by_level or [np.empty((0, COLUMNS))])
    return together[np.argsort(-together[:, SCORE], kind="stable")]


def are_many(image: GreyImage, count: int) -> bool:
    """Whether a level of a photograph, as `candidates` takes it, has so many candidates; the small
    levels, where a corner is seen as well, are looked at first."""
    levels = [*_pyramid(image)]
    return any(
        len(_of_level(levels[depth], depth)) >= count for depth in reversed(range(len(levels)))
    )


def _pyramid(image: GreyImage) -> Iterator[GreyImage]:
    """The photograph, and again and again at half the size."""
    level = image
    for _ in range(LEVELS):
        if min(level.shape) < SMALLEST_SIDE:
            return
        yield level
        half = cv2.resize(level, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        level = np.asarray(half, dtype=np.float32)


def _of_level(level: GreyImage, depth: int) -> FloatArray:
    """(n, 16): the candidates of a level, in its own px."""
    smooth: GreyImage = np.asarray(cv2.GaussianBlur(level, (5, 5), SMOOTHING), np.float32)
    starts = _starts(smooth, WEAKEST**2)
    best = np.argsort(-starts[:, ALL], kind="stable")[:MAXIMUM_STARTS]
    p = np.ascontiguousarray(starts[best, :ALL])
    scores = np.zeros((len(p), 2))
    _fit_starts(level, p, scores)
    return np.column_stack([p, scores, np.full(len(p), depth)])[scores[:, 0] > 0.0]
