"""Detect recordings whose geometry does not determine the pose of the cameras."""

from __future__ import annotations

import numpy as np

from stereocal.refined.refine import RefinedResult
from stereocal.refined.two_views import EPSILON
from stereocal.rig.compiled import FloatArray
from stereocal.system.numbers import rounded

MAXIMUM_SIGMA = np.radians(3.0)
"""An angle with a larger standard error counts as undetermined."""

FLATNESS = 0.02
"""Points whose RMS distance from a plane is a smaller fraction of their depth count as coplanar."""
MAXIMUM_NOISE_PX = 5.0
"""A fit with more noise explains nothing, and its 3D points are not used."""
NARROW_FIELD = np.radians(6.0)
"""In a smaller field of view all rays are nearly parallel: there is hardly any perspective."""
PARALLEL = np.radians(8.0)
"""Bars within this angle of a common direction count as parallel."""


def geometry_warning(fit: RefinedResult) -> str:
    """Why the pose of the cameras is poorly determined, and what to record; empty if it is not.

    Args:
        fit: a fit with wide priors, such as that of the screening.
    """
    if not fit.sigma_px.value < MAXIMUM_NOISE_PX:
        return ""
    largest = float(np.max(np.sqrt(np.diag(fit.covariance)[: EPSILON + 1])))
    ends = fit.used_points_m
    points = ends.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    flat = False
    if len(points) > 3:  # the RMS distance from the best plane
        smallest = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
        flat = smallest / np.sqrt(len(points)) < FLATNESS * np.median(points[:, 2])
    if not (largest > MAXIMUM_SIGMA or flat):
        return ""
    known = f"the largest standard error of an angle is {np.degrees(largest):.1f} degrees"
    if len(points) and _field_of_view(points) < NARROW_FIELD:
        return (
            f"The bars cover only {np.degrees(_field_of_view(points)):.1f} degrees of the view, "
            f"where perspective hardly shows: {known}. Use shorter lenses, or move the bar "
            "through the whole view and the whole depth."
        )
    if flat:
        return (
            f"All bars lie close to one plane ({rounded(np.median(points[:, 2]), 3)} m away): "
            f"{known}, because two poses of the cameras give the same images of a plane. Record "
            "the bar at other depths too."
        )
    directions = ends[:, 1] - ends[:, 0]
    directions = directions[np.isfinite(directions).all(axis=1)]
    if len(directions) > 1 and _direction_spread(directions) < PARALLEL:
        return f"All bars are parallel: {known}. Turn the bar between the photographs."
    return f"These frames determine the pose of the cameras poorly: {known}. Record more bars."


def _field_of_view(points: FloatArray) -> float:
    """Twice the largest angle between the rays to the points (n, 3) and their mean, in radians."""
    rays = points / np.linalg.norm(points, axis=1, keepdims=True)
    mean = rays.mean(axis=0)
    cosines = rays @ (mean / np.linalg.norm(mean))
    return float(2.0 * np.arccos(np.clip(cosines.min(), -1.0, 1.0)))


def _direction_spread(directions: FloatArray) -> float:
    """RMS angle between bars (n, 3) and their common axis, in radians; ends may be swapped."""
    unit = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    _, _, axes = np.linalg.svd(unit)
    return float(np.sqrt(np.mean(np.square(np.arccos(np.clip(np.abs(unit @ axes[0]), 0.0, 1.0))))))
