"""Lengths of bars as their images alone determine them, held against the stated ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from stereocal.refined.refine import RefinedResult
from stereocal.refined.solve import Solve
from stereocal.rig.compiled import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Innovations:
    """Of each frame, or part of one; NaN without a bar."""

    frames: IntArray
    """(f,)."""
    errors_m: FloatArray
    """(f,): length from the pixels alone minus the stated length."""
    variances_m2: FloatArray
    """(f,): its variance from the noise of the pixels."""
    points_m: FloatArray
    """(f, 2, 3): the points, fitted to the pixels alone."""
    of_pixels: FloatArray
    """(25, 25): information matrix of the pixels alone."""


def bar_innovations(result: RefinedResult, rows: BoolArray) -> Innovations:
    """The lengths of bars with a refined set.

    Args:
        rows: mask (n,) of the rows of the data set; they need not be those that were fitted.
    """
    solve = Solve(result.dataset, result.pose, result.settings, rows)
    solve.sigma_px, n = result.sigma_px.value, len(solve.points)
    _, H, _ = solve.sum_at(result.q, 0.0, np.full(n, np.inf), solve.points, np.empty(n))
    found = solve.innovations(result.q, solve.points)
    frames = solve.frames[solve.frame_of]
    return Innovations(frames, found[:, 0], found[:, 1], solve.points.reshape(n, 2, 3), H)


def length_freedom(result: RefinedResult, bars: Innovations) -> float:
    """Degrees of freedom of the lengths that the fit has absorbed."""
    M = result.unknowns.M
    of_lengths = M.T @ (result.information - bars.of_pixels) @ M
    return max(float(np.sum(result.p_covariance_by_model * of_lengths)), 0.0)
