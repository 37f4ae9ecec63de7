"""The image of one X-corner, fitted to sub-pixel, with the covariance of its centre.

A 2x2 checkerboard shows two straight edges that cross. Seen through a Gaussian blur of standard
deviation s, the crossing of two half-planes with signed distances l1 and l2 is
    F(h, k, rho) = E[sign(h + x) sign(k + y)],  h = l1 / s, k = l2 / s, rho = n1 . n2,
where x and y are standard normal with correlation rho: the blur acts on both distances at once.
For edges at right angles (rho = 0) this is erf(h / sqrt 2) erf(k / sqrt 2). Its value comes from
Plackett's identity, dF/drho = 4 phi2(h, k, rho), integrated as in Drezner and Wesolowsky (1990),
J. Stat. Comput. Simul. 35, 101; its derivatives are closed.

The parameters, in this order:
    0, 1    centre (u, v), px
    2, 3    directions of the two normals, rad
    4       log of the blur s, px
    5, 6    offset a and half contrast b, grey levels
    7, 8    curvature of the two edges, 1/px: what a lens does to a straight line
    9 - 12  gradients of a and of b over the window, by u and by v: shade and vignetting
The last six have priors around 0, so that a small window leaves them there and a large one finds
them; what they leave unknown is in the covariance.
"""

from __future__ import annotations

import math

import numpy as np

from stereocal.compiled import FloatArray, compiled, inlined

CORE, ALL = 7, 13
FRAME = 17
ROOT_HALF, ROOT_TWO_BY_PI = math.sqrt(0.5), math.sqrt(2.0 / math.pi)
CURVATURE_SIGMA = 3e-5
"""1/px. A line at distance d from the axis of a lens bends by 2 k1 d / f^2: 5e-6 for k1 = -0.12 and
f = 7100 px at d = 1000 px; 1.5e-4 for k1 = -0.2 and f = 1500 px at 800 px, which boards large
enough to suffer from it show clearly."""
GRADIENT_SIGMA = 0.05
"""Change of offset and contrast from the centre to the end of the window, per half contrast."""
FAR = 5.0
"""Beyond so many blurs an edge has no more effect: F differs from 1 by 6e-7."""
NODES, WEIGHTS = (np.ascontiguousarray(part) for part in np.polynomial.legendre.leggauss(6))
PIXEL_NODE = 0.5 / math.sqrt(3.0)
"""Gauss points of a pixel of width 1: sums over 2x2 of them integrate cubics over its area."""


@compiled
def fill_frame(p: FloatArray, radius: float, samples: int, frame: FloatArray) -> None:
    """Fills (14,): what all pixels share, so that no pixel needs a sine."""
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
def _crossing(h: float, k: float, frame: FloatArray) -> tuple[float, float, float, float]:
    """F and its derivatives by h, k and rho."""
    rho, root = frame[4], frame[5]
    near_h, near_k = abs(h) < FAR, abs(k) < FAR
    erf_h = math.erf(h * ROOT_HALF) if near_h else math.copysign(1.0, h)
    erf_k = math.erf(k * ROOT_HALF) if near_k else math.copysign(1.0, k)
    value, by_h, by_k, by_rho = erf_h * erf_k, 0.0, 0.0, 0.0
    if frame[FRAME - 1] == 0.0:
        by_h = ROOT_TWO_BY_PI * math.exp(-0.5 * h * h) * erf_k if near_h else 0.0
        by_k = ROOT_TWO_BY_PI * math.exp(-0.5 * k * k) * erf_h if near_k else 0.0
        return value, by_h, by_k, by_rho
    square, product = h * h + k * k, h * k
    if square >= 40.0:
        # Far from the crossing only one edge is near, and F is that edge's.
        if near_h:
            by_h = math.copysign(ROOT_TWO_BY_PI, k) * math.exp(-0.5 * h * h)
        if near_k:
            by_k = math.copysign(ROOT_TWO_BY_PI, h) * math.exp(-0.5 * k * k)
        return value, by_h, by_k, by_rho
    if near_h:
        by_h = math.exp(-0.5 * h * h) * math.erf((k - rho * h) / root * ROOT_HALF)
        by_h *= ROOT_TWO_BY_PI
    if near_k:
        by_k = math.exp(-0.5 * k * k) * math.erf((h - rho * k) / root * ROOT_HALF)
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
def model(p: FloatArray, frame: FloatArray, x: float, y: float, slope: FloatArray) -> float:
    """Grey level of the pixel at (x, y); fills `slope`, its derivatives by the 13 parameters."""
    cos1, sin1, cos2, sin2 = frame[0], frame[1], frame[2], frame[3]
    sharp, by_angle = frame[7], frame[8]
    per_radius, count = frame[FRAME - 2], max(1, int(frame[FRAME - 1]))
    slope[:] = 0.0
    gx, gy = (x - p[0]) * per_radius, (y - p[1]) * per_radius
    half = p[6] + p[11] * gx + p[12] * gy
    f = 0.0
    for i in range(count):
        dx, dy = x - p[0], y - p[1]
        if count > 1:
            dx += PIXEL_NODE * (2 * (i & 1) - 1)
            dy += PIXEL_NODE * ((i & 2) - 1)
        n1, t1 = cos1 * dx + sin1 * dy, cos1 * dy - sin1 * dx
        n2, t2 = cos2 * dx + sin2 * dy, cos2 * dy - sin2 * dx
        h = (n1 + 0.5 * p[7] * t1 * t1) * sharp
        k = (n2 + 0.5 * p[8] * t2 * t2) * sharp
        if i == 0 and min(abs(h), abs(k)) > FAR + 1.5 * sharp:
            f = count * math.copysign(1.0, h * k)
            break
        value, by_h, by_k, by_rho = _crossing(h, k, frame)
        f += value
        along1, along2 = by_h * sharp, by_k * sharp
        slope[0] -= along1 * (cos1 - p[7] * t1 * sin1) + along2 * (cos2 - p[8] * t2 * sin2)
        slope[1] -= along1 * (sin1 + p[7] * t1 * cos1) + along2 * (sin2 + p[8] * t2 * cos2)
        slope[2] += along1 * t1 * (1.0 - p[7] * n1) + by_rho * by_angle
        slope[3] += along2 * t2 * (1.0 - p[8] * n2) - by_rho * by_angle
        slope[4] -= by_h * h + by_k * k
        slope[7] += along1 * 0.5 * t1 * t1
        slope[8] += along2 * 0.5 * t2 * t2
    f /= count
    for j in (0, 1, 2, 3, 4, 7, 8):
        slope[j] *= half / count
    slope[0] -= (p[9] + p[11] * f) * per_radius
    slope[1] -= (p[10] + p[12] * f) * per_radius
    slope[5], slope[6] = 1.0, f
    slope[9], slope[10], slope[11], slope[12] = gx, gy, gx * f, gy * f
    grey: float = p[5] + p[9] * gx + p[10] * gy + half * f
    return grey
