"""The noise of image points with its uncertainty and its tails, from standardised residuals.

A pair of points has one residual that the position of the target cannot absorb: its distance from
the epipolar line. Divided by its standard deviation, and by the share of it that the fit has not
absorbed, it is 1 on average. Its distribution is that of Student with unknown scale and degrees of
freedom; their posterior is computed on a grid. Half of the prior belongs to the normal
distribution.
"""

from __future__ import annotations

import numpy as np
from scipy.special import gammaln

from stereocal.refined.refine import RefinedResult
from stereocal.rig.compiled import FloatArray

DEGREES = np.array([3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, np.inf])
PRIOR = np.append(np.full(len(DEGREES) - 1, 0.5 / (len(DEGREES) - 1)), 0.5)
SCALES = np.geomspace(0.3, 2.0, 160)


def standardised_residuals(model: RefinedResult) -> FloatArray:
    """Distances of pairs from their epipolar lines over their standard deviations, (n,).

    To first order (Sampson), of the rows that the model used; the noise is that of the model.
    """
    table, rows = model.dataset.correspondences, model.used_rows
    one = np.column_stack([model.primary.undistort(table.primary[rows]), np.ones(rows.sum())])
    two = np.column_stack([model.secondary.undistort(table.secondary[rows]), np.ones(rows.sum())])
    E = model.pose.essential
    by_two, by_one = one @ E.T, two @ E
    scales = [np.array([c.K[0, 0], c.K[1, 1]]) for c in (model.primary, model.secondary)]
    variance = np.sum(np.square(by_one[:, :2] / scales[0]), axis=1)
    variance += np.sum(np.square(by_two[:, :2] / scales[1]), axis=1)
    residual = np.sum(two * by_two, axis=1)
    return np.asarray(residual / (model.sigma_px.value * np.sqrt(variance)))


def draw_noise(
    residuals: FloatArray, absorbed: float, draws: int, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Scales (relative to the model's noise) and degrees of freedom (infinite if normal), (draws,).

    Args:
        residuals: (n,), from `standardised_residuals`.
        absorbed: degrees of freedom of the residuals that the fit has absorbed.
    """
    n = len(residuals)
    left = max(n - absorbed, 1.0) / n
    squares = np.square(residuals) / left
    density = np.empty((len(DEGREES), len(SCALES)))
    for i, nu in enumerate(DEGREES):
        ratio = squares[:, None] / np.square(SCALES)
        if np.isinf(nu):
            shape = -0.5 * ratio - 0.5 * np.log(2 * np.pi)
        else:
            constant = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
            shape = constant - 0.5 * (nu + 1) * np.log1p(ratio / nu)
        density[i] = left * (shape - np.log(SCALES)).sum(axis=0) + np.log(PRIOR[i])
    chance = np.exp(density - density.max()).ravel()
    drawn = rng.choice(chance.size, draws, p=chance / chance.sum())
    return SCALES[drawn % len(SCALES)], DEGREES[drawn // len(SCALES)]


def noise_of_points(degrees: FloatArray, points: int, rng: np.random.Generator) -> FloatArray:
    """Noise of u, v in both images in units of the scale, (draws, points, 4).

    The two coordinates of a point share a factor, so that a point that is off is off in both.
    """
    found = rng.standard_normal((len(degrees), points, 4))
    for own, nu in zip(found, degrees, strict=True):
        if np.isfinite(nu):
            factor = np.sqrt(nu / rng.chisquare(nu, (points, 2)))
            own *= np.repeat(factor, 2, axis=1)
    return found
