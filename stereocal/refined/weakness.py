"""What a recording leaves undetermined whatever its noise, and why: where the bar was not."""

from __future__ import annotations

import numpy as np

from stereocal.refined.bar_fit import EPSILON
from stereocal.refined.refine import RefinedResult
from stereocal.rig.compiled import FloatArray

LOOSE = np.radians(3.0)
"""An angle with a larger standard error is not determined."""

FLAT = 0.02
"""Points within this part of their depth of one plane lie in one plane."""
MOST_NOISE_PX = 5.0
"""A fit that leaves more explains nothing, so its points say nothing of the recording."""
NARROW = np.radians(6.0)
"""A field of view in which perspective hardly shows: all rays are nearly parallel."""
ALIKE = np.radians(8.0)
"""Bars within this angle of one direction are parallel."""


def weakness(fit: RefinedResult) -> str:
    """Why the pose of the cameras is loose, and what to record; empty where it is not.

    Args:
        fit: with wide priors, as the screening's.
    """
    if not fit.sigma_px.value < MOST_NOISE_PX:
        return ""
    loosest = float(np.max(np.sqrt(np.diag(fit.covariance)[: EPSILON + 1])))
    ends = fit.places_m[~fit.outlying]
    points = ends.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    flat = len(points) > 3 and _thickness(points) < FLAT
    if not (loosest > LOOSE or flat):
        return ""
    known = f"an angle of the cameras is known to {np.degrees(loosest):.1f} degrees only"
    if len(points) and _angle_seen(points) < NARROW:
        return (
            f"The lenses see only {np.degrees(_angle_seen(points)):.1f} degrees of the scene, "
            f"where perspective hardly shows: {known}. Use shorter lenses, or bring the bar "
            "through the whole view and far through the depth."
        )
    if flat:
        return (
            f"All bars lie about one plane ({np.median(points[:, 2]):.3g} m away): {known}, since "
            "two positions of the cameras see one plane alike. Record the bar near and far too."
        )
    directions = ends[:, 1] - ends[:, 0]
    directions = directions[np.isfinite(directions).all(axis=1)]
    if len(directions) > 1 and _turned(directions) < ALIKE:
        return f"All bars point the same way: {known}. Turn the bar between the photographs."
    return f"These frames determine the position of the cameras poorly: {known}. Record more bars."


def _angle_seen(points: FloatArray) -> float:
    """The largest angle between the rays to the points (n, 3) and their mean, twice."""
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    middle = rays.mean(axis=0)
    cosines = rays @ (middle / np.linalg.norm(middle))
    return float(2.0 * np.arccos(np.clip(cosines.min(), -1.0, 1.0)))


def _thickness(points: FloatArray) -> float:
    """RMS distance of points (n, 3) from their best plane, as a part of their depth."""
    smallest = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
    return float(smallest / np.sqrt(len(points)) / np.median(points[:, 2]))


def _turned(directions: FloatArray) -> float:
    """RMS angle between bars (n, 3) and their common direction, whichever end is first."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    _, _, axes = np.linalg.svd(unit)
    return float(np.sqrt(np.mean(np.square(np.arccos(np.clip(np.abs(unit @ axes[0]), 0.0, 1.0))))))
