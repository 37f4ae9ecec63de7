"""The model of the image of an X-corner, with derivatives.

A 2x2 checkerboard has two straight edges that cross. Let l1 and l2 be the signed distances to the
edges and s the standard deviation of a Gaussian blur. The normalised intensity is
    F(h, k, rho) = E[sign(h + x) sign(k + y)],  h = l1 / s, k = l2 / s, rho = n1 . n2,
where x and y are standard normal with correlation rho, because the blur affects both distances.
For perpendicular edges (rho = 0) this is erf(h / sqrt 2) erf(k / sqrt 2). In general F follows from
Plackett's identity, dF/drho = 4 phi2(h, k, rho), integrated as in Drezner and Wesolowsky (1990),
J. Stat. Comput. Simul. 35, 101; its derivatives have closed forms.

The parameters, in this order:
    0, 1    centre (u, v), px
    2, 3    directions of the two normals, rad
    4       log of the blur s, px
    5, 6    offset a and half contrast b, grey levels
    7, 8    curvature of the two edges by lens distortion, 1/px
    9, 10   gradient of a over the window by u and by v, grey levels: stray light
    11, 12  relative gradient of the light over the window, for a and b alike: shading, vignetting
The last six have priors with mean 0: in a small window they remain close to 0, in a large one they
are estimated. The covariance includes their uncertainty.
"""

import math

import numpy as np

from stereocal.rig.compiled import compiled, inlined
from stereocal.system.array_types import FloatArray

CORE, ALL, LIGHT = 7, 13, 11
"""Parameters without priors, all of them, and the first of the gradient of the light."""
FRAME = 17
"""What all pixels share (`fill_frame`):
    0 to 3  cosine and sine of the first normal's direction, then of the second's
    4, 5    rho and sqrt(1 - rho^2)
    6       asin(rho) / pi: 2 / pi times half the interval of Plackett's integral over theta
    7       1 / s, 1/px
    8       drho / d(direction of the first normal); by the second's it is minus that
    9 to 14 sin(theta) at the nodes of the integral, theta from 0 to asin(rho)
    15, 16  1 / radius of the window, 1/px, and the samples of a pixel
"""
ROOT_HALF, ROOT_TWO_BY_PI = math.sqrt(0.5), math.sqrt(2.0 / math.pi)
CURVATURE_SIGMA = 3e-5
"""1/px. The curvature of a line at distance d from the optical axis is 2 k1 d / f^2: 5e-6 for
k1 = -0.12 and f = 7100 px at d = 1000 px; 1.5e-4 for k1 = -0.2 and f = 1500 px at 800 px, where
boards large enough for it to matter determine it well."""
GRADIENT_SIGMA = 0.05
"""Change of the offset from the centre to the edge of the window, over half contrast."""
LIGHT_SIGMA = 0.1
"""Change of the light from the centre to the edge of the window, relative."""
FAR = 5.0
"""Distance from an edge, in blurs, beyond which its effect is neglected: F is within 6e-7 of 1."""
FAR_FROM_CROSSING = 40.0
"""h^2 + k^2 beyond which the second term of F is neglected: of perpendicular edges dF/drho is at
most 2 / pi exp(-20) = 1.3e-9 there."""
NODES, WEIGHTS = (np.ascontiguousarray(part) for part in np.polynomial.legendre.leggauss(6))
PIXEL_NODE = 0.5 / math.sqrt(3.0)
"""Gauss points of a pixel of width 1: 2x2 of them integrate cubics over its area exactly."""


@compiled
def fill_frame(p: FloatArray, radius: float, samples: int, frame: FloatArray) -> None:
    """Write the quantities that all pixels share to `frame` (FRAME,), such as sines and cosines."""
    cos1, sin1 = math.cos(p[2]), math.sin(p[2])
    cos2, sin2 = math.cos(p[3]), math.sin(p[3])
    rho = cos1 * cos2 + sin1 * sin2
    reach = math.asin(min(max(rho, -1.0), 1.0))
    frame[0], frame[1], frame[2], frame[3] = cos1, sin1, cos2, sin2
    frame[4], frame[5], frame[6] = rho, math.sqrt(max(1.0 - rho * rho, 1e-6)), reach / math.pi
    frame[7], frame[8] = math.exp(-p[4]), sin2 * cos1 - cos2 * sin1
    for i in range(NODES.size):
        frame[9 + i] = math.sin(0.5 * reach * (1.0 + NODES[i]))
    frame[FRAME - 2], frame[FRAME - 1] = 1.0 / radius, samples


@inlined
def _quick_erf(h: float, bell: float) -> float:
    """erf(h / sqrt 2) to 1.5e-7, from exp(-h^2 / 2): Abramowitz and Stegun (1964), 7.1.26."""
    t = 1.0 / (1.0 + 0.3275911 * ROOT_HALF * abs(h))
    tail = t * (-1.453152027 + t * 1.061405429)
    tail = t * (0.254829592 + t * (-0.284496736 + t * (1.421413741 + tail)))
    return math.copysign(1.0 - tail * bell, h)


@inlined
def _crossing(h: float, k: float, frame: FloatArray) -> tuple[float, float, float, float]:
    """F and its derivatives by h, k and rho.

    F = erf(h / sqrt 2) erf(k / sqrt 2) + (2 / pi) integral of exp(-q(theta) / 2) over theta from 0
    to asin(rho), where q = (h^2 - 2 h k sin(theta) + k^2) / cos(theta)^2; dF/drho is the integrand
    of rho, and dF/dh = 2 phi(h) erf((k - rho h) / sqrt(2 (1 - rho^2))).
    """
    rho, root = frame[4], frame[5]
    near_h, near_k = abs(h) < FAR, abs(k) < FAR
    bell_h = math.exp(-0.5 * h * h) if near_h else 0.0
    bell_k = math.exp(-0.5 * k * k) if near_k else 0.0
    if frame[FRAME - 1] == 0.0:
        quick_h, quick_k = _quick_erf(h, bell_h), _quick_erf(k, bell_k)
        by_h, by_k = ROOT_TWO_BY_PI * bell_h * quick_k, ROOT_TWO_BY_PI * bell_k * quick_h
        return quick_h * quick_k, by_h, by_k, 0.0
    erf_h = math.erf(h * ROOT_HALF) if near_h else math.copysign(1.0, h)
    erf_k = math.erf(k * ROOT_HALF) if near_k else math.copysign(1.0, k)
    value, by_h, by_k, by_rho = erf_h * erf_k, 0.0, 0.0, 0.0
    square, product = h * h + k * k, h * k
    if square >= FAR_FROM_CROSSING:
        # Far from the crossing at most one edge is near, and F depends only on that edge.
        if near_h:
            by_h = math.copysign(ROOT_TWO_BY_PI, k) * bell_h
        if near_k:
            by_k = math.copysign(ROOT_TWO_BY_PI, h) * bell_k
        return value, by_h, by_k, by_rho
    if near_h:
        by_h = bell_h * math.erf((k - rho * h) / root * ROOT_HALF)
        by_h *= ROOT_TWO_BY_PI
    if near_k:
        by_k = bell_k * math.erf((h - rho * k) / root * ROOT_HALF)
        by_k *= ROOT_TWO_BY_PI
    total = 0.0
    for i in range(NODES.size):
        sine = frame[9 + i]
        total += WEIGHTS[i] * math.exp(-0.5 * (square - 2.0 * sine * product) / (1.0 - sine * sine))
    value += total * frame[6]
    by_rho = 2.0 / (math.pi * root)
    by_rho *= math.exp(-0.5 * (square - 2.0 * rho * product) / (root * root))
    return value, by_h, by_k, by_rho


@compiled
def fill_rows(
    p: FloatArray, frame: FloatArray, pixels: FloatArray, first: int, count: int, rows: FloatArray
) -> None:
    """Write the derivatives and residuals of the model at `count` pixels, starting at `first`.

    Args:
        p: (13,).
        frame: from `fill_frame`.
        pixels: (n, 3): u, v, grey level.
        rows: (14, count) or more columns, written: the derivatives of the grey level by the 13
            parameters, and last the model's grey level minus that of the pixel.
    """
    cos1, sin1, cos2, sin2 = frame[0], frame[1], frame[2], frame[3]
    sharp, by_angle = frame[7], frame[8]
    per_radius, over_area = frame[FRAME - 2], frame[FRAME - 1] > 1.0
    u, v, contrast, curve1, curve2 = p[0], p[1], p[6], p[7], p[8]
    for n in range(count):
        x, y = pixels[first + n, 0] - u, pixels[first + n, 1] - v
        gx, gy = x * per_radius, y * per_radius
        f, by_u, by_v, by_1, by_2 = 0.0, 0.0, 0.0, 0.0, 0.0
        by_blur, by_curve1, by_curve2, share = 0.0, 0.0, 0.0, 1.0
        for i in range(4):
            dx, dy = x, y
            if over_area:
                dx += PIXEL_NODE * (2 * (i & 1) - 1)
                dy += PIXEL_NODE * ((i & 2) - 1)
            n1, t1 = cos1 * dx + sin1 * dy, cos1 * dy - sin1 * dx
            n2, t2 = cos2 * dx + sin2 * dy, cos2 * dy - sin2 * dx
            h = (n1 + 0.5 * curve1 * t1 * t1) * sharp
            k = (n2 + 0.5 * curve2 * t2 * t2) * sharp
            if i == 0 and min(abs(h), abs(k)) > FAR + 1.5 * sharp:
                f = 1.0 if (h > 0.0) == (k > 0.0) else -1.0
                break
            value, by_h, by_k, by_rho = _crossing(h, k, frame)
            f += value
            along1, along2 = by_h * sharp, by_k * sharp
            by_u -= along1 * (cos1 - curve1 * t1 * sin1) + along2 * (cos2 - curve2 * t2 * sin2)
            by_v -= along1 * (sin1 + curve1 * t1 * cos1) + along2 * (sin2 + curve2 * t2 * cos2)
            by_1 += along1 * t1 * (1.0 - curve1 * n1) + by_rho * by_angle
            by_2 += along2 * t2 * (1.0 - curve2 * n2) - by_rho * by_angle
            by_blur -= by_h * h + by_k * k
            by_curve1 += along1 * 0.5 * t1 * t1
            by_curve2 += along2 * 0.5 * t2 * t2
            if not over_area:
                break
            if i == 3:
                share = 0.25
        f *= share
        light, level = 1.0 + p[11] * gx + p[12] * gy, p[5] + contrast * f
        share *= light * contrast
        rows[0, n] = share * by_u - (p[9] + p[11] * level) * per_radius
        rows[1, n] = share * by_v - (p[10] + p[12] * level) * per_radius
        rows[2, n], rows[3, n], rows[4, n] = share * by_1, share * by_2, share * by_blur
        rows[5, n], rows[6, n], rows[7, n], rows[8, n] = (
            light,
            light * f,
            share * by_curve1,
            share * by_curve2,
        )
        rows[9, n], rows[10, n], rows[11, n], rows[12, n] = gx, gy, gx * level, gy * level
        rows[13, n] = light * level + p[9] * gx + p[10] * gy - pixels[first + n, 2]
