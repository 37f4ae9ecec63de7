"""The noise of image points with its uncertainty and its tails, from standardised residuals.

The four pixel coordinates of a pair have one combination that no position of the target can absorb:
the distance from the epipolar line. The other three move the reconstructed point, and show in the
lengths of the bars. Both noises need not be alike: a wrong distortion, or cameras that are slightly
out of step, add to the first (on a real recording it was 1.4 times the second).

A residual over its standard deviation, and over the share of it that the fit has not absorbed, is 1
on average. The distribution across the lines is that of Student with unknown scale and degrees of
freedom; their posterior is computed on a grid. Half of the prior belongs to the normal
distribution, and half to equal noise along and across the lines.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from stereocal.refined.innovations import bar_innovations, length_freedom
from stereocal.refined.refine import RefinedResult
from stereocal.rig.compiled import FloatArray

DEGREES = np.array([3.0, 4.0, 5.0, 7.0, 10.0, 15.0, 30.0, np.inf])
PRIOR = np.append(np.full(len(DEGREES) - 1, 0.5 / (len(DEGREES) - 1)), 0.5)
SCALES = np.geomspace(0.3, 2.0, 160)
LARGEST_SHIFT = 77
"""Noise along over noise across the lines is between 0.4 and 2.5; in steps of `SCALES`."""


@dataclass(frozen=True)
class NoiseDraws:
    """Draws of what describes the noise, each (draws,)."""

    across: FloatArray
    """Noise across the epipolar lines, relative to that of the model."""
    along: FloatArray
    """The noise that moves the reconstructed point, relative to `across`."""
    degrees: FloatArray
    """Degrees of freedom; infinite if normal."""


def draw_noise(model: RefinedResult, draws: int, rng: np.random.Generator) -> NoiseDraws:
    """Draw the noise of the images of a model."""
    residuals = model.standardised_residuals[model.used_rows]
    M, used = model.unknowns.M, ~model.outlying
    spent = float(np.sum(model.p_covariance_by_model * (M.T @ model.information @ M)))
    freedom = float(model.degrees_of_freedom[used].sum())
    pairs = float(np.isfinite(model.used_points_m[:, :, 0]).sum())
    left = max(pairs * (1.0 - spent / freedom), 1.0)
    bars = bar_innovations(model, model.used_rows)
    lengths = bars.errors_m / np.sqrt(bars.variances_m2 + model.scatter_m.value**2)
    lengths, absorbed = lengths[np.isfinite(lengths)], length_freedom(model, bars)
    return noise_given(residuals, len(residuals) - left, lengths, absorbed, draws, rng)


def noise_given(
    residuals: FloatArray,
    absorbed: float,
    lengths: FloatArray,
    absorbed_lengths: float,
    draws: int,
    rng: np.random.Generator,
) -> NoiseDraws:
    """Draw the noise given the standardised residuals of pairs (n,) and of lengths (m,).

    Args:
        absorbed, absorbed_lengths: degrees of freedom of either that the fit has absorbed.
    """
    density = _log_density(residuals, absorbed) + np.log(PRIOR)[:, None]
    chance = np.exp(density - density.max()).ravel()
    drawn = rng.choice(chance.size, draws, p=chance / chance.sum())
    of_scale, of_degrees = drawn % len(SCALES), drawn // len(SCALES)
    of_lengths = _log_density(lengths, absorbed_lengths)
    shifts = np.arange(-LARGEST_SHIFT, LARGEST_SHIFT + 1)
    prior = np.where(shifts == 0, 0.5, 0.5 / (2 * LARGEST_SHIFT))
    at = np.clip(of_scale[:, None] + shifts, 0, len(SCALES) - 1)
    chances = of_lengths[of_degrees[:, None], at] + np.log(prior)
    chosen = shifts[np.argmax(chances + rng.gumbel(size=chances.shape), axis=1)]
    along = np.exp(chosen * np.log(SCALES[1] / SCALES[0]))
    return NoiseDraws(SCALES[of_scale], along, DEGREES[of_degrees])


def _log_density(residuals: FloatArray, absorbed: float) -> FloatArray:
    """(DEGREES, SCALES): log-likelihood of standardised residuals (n,).

    Args:
        absorbed: degrees of freedom of the residuals that the fit has absorbed.
    """
    n = max(len(residuals), 1)
    left = max(len(residuals) - absorbed, 1.0) / n
    squares = np.square(residuals) / left
    density = np.empty((len(DEGREES), len(SCALES)))
    for i, nu in enumerate(DEGREES):
        ratio = squares[:, None] / np.square(SCALES)
        if np.isinf(nu):
            shape = -0.5 * ratio - 0.5 * np.log(2 * np.pi)
        else:
            constant = gammaln((nu + 1) / 2) - gammaln(nu / 2) - 0.5 * np.log(nu * np.pi)
            shape = constant - 0.5 * (nu + 1) * np.log1p(ratio / nu)
        density[i] = left * (shape - np.log(SCALES)).sum(axis=0)
    return density


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
