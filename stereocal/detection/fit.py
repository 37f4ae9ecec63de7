"""Fit one X-corner: its centre with covariance, and the extent of its board.

The fit (`corner_model`) starts in a small window. The contrast across the four arms shows where the
board ends, and the window grows until it covers most of the board without its outer border.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from stereocal.detection.corner_model import (
    ALL,
    CORE,
    CURVATURE_SIGMA,
    GRADIENT_SIGMA,
    LIGHT,
    LIGHT_SIGMA,
)
from stereocal.detection.edges import arm_quality, follow
from stereocal.detection.intensity import GreyImage
from stereocal.detection.solver import covariance_and_noise, fit_parameters
from stereocal.rig.compiled import compiled
from stereocal.system.array_types import FloatArray

INSIDE = 0.96
"""Fraction of each arm that the window covers, minus one blur, since a board in perspective is not
a parallelogram, and its border is blurred."""
SMALLEST_HALF_WINDOW = 2.5
GROWTH = 3.0
PIXELS_WHILE_GROWING = 1500
"""About so many are used of a window that still grows."""
SMALLEST_SINE = 0.35
"""Sine of 20 degrees, the least angle between the edges: a board tilted by 70 degrees."""
BORDER_REACH = 30.0
"""Maximum length of the arms of a board at the border, in half windows."""
WORST_ARMS = 0.4
ROUNDS = 30
WHILE_GROWING_PX, AT_LAST_PX = 1e-2, 1e-5
"""Tolerances of the fits."""
MISFIT = 0.06
"""Scale of `Corner.misfit` in the quality: boards have 0.00 to 0.03, pickets and leaves 0.05 to
0.15."""
PATTERN, SMALLER, SUSPECT = 0.035, 0.7, 0.055
"""If the misfit is above `PATTERN`, the window is reduced by the factor `SMALLER`, since something
behind the board may have extended an arm. If that fit is good, the misfit is set to `SUSPECT`."""
PIXEL_VARIANCE = 1.0 / 12.0
"""px^2: the blur by the area of a pixel, if the model averages over it."""
MAXIMUM_CORRELATION = 0.9
"""Correlation of neighbouring residuals; above it the sum would be infinite."""
SHARP = 1.3
"""Blur in px below which the model is averaged over each pixel."""


@dataclass(frozen=True, eq=False)
class Corner:
    """A fitted X-corner. Lengths are in px, intensities in grey levels of the photograph."""

    centre: FloatArray
    """(2,): u, v."""
    covariance: FloatArray
    """(2, 2), px^2."""
    directions: FloatArray
    """(2, 2): unit vectors along the two edges."""
    arms: FloatArray
    """(4,): lengths of the half edges: forward and back along the first, then the second edge."""
    flips: int
    """Number of arms followed by another square, as in a larger chessboard."""
    cut: int
    """Bit i is set if arm i ends at the border of the image."""
    blur: float
    """Standard deviation."""
    contrast: float
    """White minus black."""
    black: float
    white: float
    residual: float
    """RMS of the residuals."""
    misfit: float
    """RMS of the residuals that is not noise, over the contrast."""

    @property
    def sigma_px(self) -> float:
        """Standard deviation of the centre, RMS of both directions."""
        return math.sqrt(0.5 * float(np.trace(self.covariance)))

    @property
    def quality(self) -> float:
        """0 to 1; reduced by a misfit and by short or unequal arms.

        Most saddle points of leaves, fences and clouds have less than 0.6.
        """
        return arm_quality(self.arms, self.cut, self.blur) * self.fit_quality

    @property
    def fit_quality(self) -> float:
        """0 to 1; reduced by a misfit."""
        return math.exp(-0.5 * (self.misfit / MISFIT) ** 2)

    @property
    def lengths(self) -> FloatArray:
        """(2,): lengths of the board along its two edges, twice the shorter arm."""
        return np.array([2.0 * min(self.arms[:2]), 2.0 * min(self.arms[2:])])

    @property
    def board_px(self) -> float:
        """Size of the board, the mean of its two lengths."""
        return float(self.lengths.mean())


def _directions(p: FloatArray) -> FloatArray:
    """(2, 2): unit vectors along the edges, whose normals have the angles p[2] and p[3]."""
    return np.array([[-math.sin(angle), math.cos(angle)] for angle in p[2:4]])


def _fit(
    image: GreyImage,
    p: FloatArray,
    half: FloatArray,
    noise: float,
    size: int,
    stride: int,
    samples: int,
    tolerance: float = WHILE_GROWING_PX,
) -> tuple[FloatArray, FloatArray, FloatArray, bool]:
    """Fit in one window; returns pixels, parameters, penalty, and whether the fit converged.

    Args:
        p: (13,), initial parameters of `corner_model`.
        noise: variance of a pixel, squares of grey levels.
        size: the first parameters that are fitted, `CORE` or `ALL`.
        samples: of each pixel, as of `corner_model`.
        tolerance: px.
    """
    pixels = window(image, p[0], p[1], _directions(p), half, stride)
    # (13,): weight of the square of each parameter beside the sum of squared residuals.
    penalty = np.zeros(ALL)
    radius = float(half.max())
    penalty[7:9] = noise / CURVATURE_SIGMA**2
    penalty[9:11] = noise / (GRADIENT_SIGMA * p[6]) ** 2  # p[6] is half the contrast
    penalty[LIGHT:] = noise / LIGHT_SIGMA**2
    fitted = p.copy()
    if len(pixels) <= size + 4:  # too few beside the unknowns
        return pixels, fitted, penalty, False
    _, converged = fit_parameters(pixels, fitted, size, radius, samples, penalty, ROUNDS, tolerance)
    return pixels, fitted, penalty, converged


def _stride(half: FloatArray) -> int:
    """The step of rows and columns at which a window, as of `window`, of 4 half[0] half[1] pixels
    has about `PIXELS_WHILE_GROWING`."""
    return max(1, round(math.sqrt(4.0 * half[0] * half[1] / PIXELS_WHILE_GROWING)))


@compiled
def window(
    image: GreyImage, u: float, v: float, along: FloatArray, half: FloatArray, stride: int
) -> FloatArray:
    """(n, 3): u, v and grey level of the pixels of a parallelogram around (u, v).

    A pixel at (dx, dy) from the centre is at `first` and `second`, px, along the two edges:
    (dx, dy) = first along[0] + second along[1], solved by Cramer's rule.

    Args:
        along: (2, 2), unit vectors along the two edges.
        half: (2,), half size along each of them, px.
        stride: step of rows and columns.
    """
    height, width = image.shape
    # Half sizes of the upright rectangle around it.
    reach_u = abs(along[0, 0]) * half[0] + abs(along[1, 0]) * half[1]
    reach_v = abs(along[0, 1]) * half[0] + abs(along[1, 1]) * half[1]
    left, right = max(0, math.ceil(u - reach_u)), min(width - 1, math.floor(u + reach_u))
    top, bottom = max(0, math.ceil(v - reach_v)), min(height - 1, math.floor(v + reach_v))
    determinant = along[0, 0] * along[1, 1] - along[0, 1] * along[1, 0]
    rows = max(0, (bottom - top) // stride + 1)
    columns = max(0, (right - left) // stride + 1)
    pixels = np.empty((rows * columns, 3))
    n = 0
    for y in range(top, bottom + 1, stride):
        for x in range(left, right + 1, stride):
            dx, dy = x - u, y - v
            first = (dx * along[1, 1] - dy * along[1, 0]) / determinant
            second = (dy * along[0, 0] - dx * along[0, 1]) / determinant
            if abs(first) <= half[0] and abs(second) <= half[1]:
                pixels[n, 0], pixels[n, 1], pixels[n, 2] = x, y, image[y, x]
                n += 1
    return pixels[:n]


@compiled
def plausible(p: FloatArray, start: FloatArray, reach: float) -> bool:
    """Whether a fit (13,) stayed within `reach`, px, of its start at a corner, with two distinct
    edges, the colours not exchanged, and a blur from 0.05 px (log -3) to twice `reach`."""
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
    """Fit the X-corner near initial parameters.

    Args:
        image: (h, w), grey levels times `gain`.
        start: (13,), the initial parameters of `corner_model`; the first seven must be close.
        half: half size of the first window along both edges, px.
        quantum: quantisation step in `image`: the gain for integer photographs, or 0.
        gain: factor of `image`, by which the intensities in the result are divided.

    Returns:
        None if there is no crossing of two edges.
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
        stride = _stride(reach)
        size = CORE if max(reach) < 8 else ALL
        _, fitted, _, _ = _fit(image, p, reach, noise, size, stride, 0)
        if not plausible(fitted, p, float(min(reach))):
            return None
        p = fitted
        if done:
            break
    if cut:
        # At the border the window is small, and the other arms are long in comparison.
        arms, flips, cut = follow(image, p, reach, BORDER_REACH)
    # One arm of an edge may be infinite, where the bar extends it; it is clipped below.
    ends = np.array([min(arms[:2]), min(arms[2:])])
    if not np.isfinite(ends).all():
        return None
    arms = np.minimum(arms, GROWTH * np.repeat(reach, 2))
    if arm_quality(arms, cut, math.exp(p[4])) < WORST_ARMS:
        return None
    final = partial(_final, image, p, noise, quantum, gain, (arms, flips, cut))
    corner = final(reach)
    if corner is None or corner.misfit > PATTERN:
        smaller = final(SMALLER * reach)
        if smaller is not None and smaller.misfit < PATTERN:
            return replace(smaller, misfit=SUSPECT)
    return corner


def _final(
    image: GreyImage,
    p: FloatArray,
    noise: float,
    quantum: float,
    gain: float,
    ends: tuple[FloatArray, int, int],
    half: FloatArray,
) -> Corner | None:
    """Fit all pixels of the final window."""
    smallest = max(quantum**2 / 12.0, (1e-5 * p[6]) ** 2)
    radius = float(half.max())
    # The first fit estimates the noise, which the weights of the priors need.
    for stride, tolerance in ((_stride(half), WHILE_GROWING_PX), (1, AT_LAST_PX)):
        samples = 4 if math.exp(p[4]) < SHARP else 1
        pixels, fitted, penalty, converged = _fit(
            image, p, half, noise, ALL, stride, samples, tolerance
        )
        if not converged or not plausible(fitted, p, float(min(half))):
            return None
        p = fitted
        # The blur of shaded light, of (1 + g x) F(x), is (1 + g x) F(x) + s^2 g F'(x) and not only
        # the first term, which is the model: all edges appear displaced by s^2 g towards the dark
        # side. This is by how much for a relative gradient of the light of 1, px.
        variance = math.exp(2.0 * p[4]) + (PIXEL_VARIANCE if samples > 1 else 0.0)
        shift = variance / radius
        measures = covariance_and_noise(pixels, p, radius, samples, penalty, shift)
        noise = max(measures.variance, smallest)
    # Not the mean over all pixels: those at the border of a small board do not move the centre.
    variance = max(measures.variance_of_centre, smallest)
    # Correlated residuals, as from the border of a shadow, count as fewer pixels: with r between
    # neighbours in rows and columns, a sum over an area has ((1 + r) / (1 - r))^2 the variance.
    # Up to 3 / sqrt(n) may be noise: three standard deviations, if all pixels weighed the same.
    r = min(max(measures.correlation - 3.0 / math.sqrt(len(pixels)), 0.0), MAXIMUM_CORRELATION)
    variance *= ((1.0 + r) / (1.0 - r)) ** 2
    if not np.isfinite(measures).all():
        return None
    uu, uv, vv = measures[:3]
    covariance = variance * np.array([[uu, uv], [uv, vv]])
    contrast = 2.0 * abs(float(p[6]))
    # The mean product of n residuals of pure noise has a standard deviation of 1 / sqrt(n) of
    # their variance.
    pattern = measures.product - 2.0 * measures.variance / math.sqrt(len(pixels))
    centre, blur, grey = p[:2] + shift * p[11:13], math.exp(p[4]), float(p[5])
    levels = contrast / gain, (grey - contrast / 2) / gain, (grey + contrast / 2) / gain
    residual, misfit = math.sqrt(measures.variance) / gain, math.sqrt(max(0.0, pattern)) / contrast
    return Corner(centre, covariance, _directions(p), *ends, blur, *levels, residual, misfit)
