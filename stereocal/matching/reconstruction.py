"""Reconstruct 3D points from matched pairs, with reprojection errors and standard errors."""

import hashlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.refined.parameter_file import covariance_of_entry
from stereocal.refined.small_steps import OF_PAIR, rig_at
from stereocal.refined.uncertainty import point_errors
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays, stack_rays, triangulate_rays
from stereocal.rig.parameters import RigParameters
from stereocal.rig.volume import Volume
from stereocal.system.array_types import BoolArray, FloatArray


class PointErrors(NamedTuple):
    """Errors of n points to first order, in metres, in the reference's frame."""

    own: FloatArray
    """(n, 3, 3): covariances by the noise of their pixels."""
    by_shared: FloatArray
    """(n, 3, q): derivatives by the parameters."""
    shared: FloatArray
    """(q, q): covariance of the parameters."""

    @property
    def covariances(self) -> FloatArray:
        """(n, 3, 3): of both."""
        return np.asarray(self.own + self.by_shared @ self.shared @ self.by_shared.swapaxes(1, 2))


@dataclass(frozen=True, eq=False)
class Points3D:
    """Points of n pairs, or of tracks."""

    xyz: FloatArray
    """(n, 3) metres; NaN where the rays do not meet in front of both cameras."""
    error_px: FloatArray
    """(n,) reprojection error, mean over both cameras; NaN likewise."""
    sigma_m: FloatArray | None = None
    """(n, 3) standard error of each coordinate; None if no noise is known."""
    outside_volume: BoolArray | None = None
    """(n,): not in the volume of the bars; true for NaN, None if the volume is unknown."""

    @classmethod
    def in_frame(
        cls,
        world: Pose | None,
        volume: Volume | None,
        xyz: FloatArray,
        error_px: FloatArray,
        covariances: FloatArray | None,
    ) -> "Points3D":
        """Points in a world frame.

        Args:
            world: `world_from_reference`; None: points in the reference's frame, as the others are.
            covariances: (n, 3, 3).
        """
        outside, sigma = None if volume is None else ~volume.contains(xyz), None
        if covariances is not None:
            turned = covariances if world is None else world.R @ covariances @ world.R.T
            sigma = np.sqrt(np.einsum("nii->ni", turned))
        return cls(xyz if world is None else world.apply(xyz), error_px, sigma, outside)


def reconstruct_points(
    rig: RigParameters,
    primary_px: npt.ArrayLike,
    secondary_px: npt.ArrayLike,
    world: Pose | None = None,
    sigma_px: float | FloatArray | None = None,
) -> Points3D:
    """Reconstruct matched pairs by midpoint triangulation.

    The standard errors contain those of the parameters that the file states. These are common to
    all points: distances between points are more precise than their positions.

    Args:
        primary_px: (n, 2) raw pixels; `secondary_px`: (n, 2), their partners row by row.
        world: `world_from_primary`; None: points in the primary's frame.
        sigma_px: standard deviation of one pixel coordinate, of all points or (n, 2) of each point
            in both cameras, for the standard errors; None: that of the file's targets.
    """
    rays = stack_rays(rig.primary.rays_of(primary_px), rig.secondary.rays_of(secondary_px))
    xyz = triangulate_rays(rig.pose.R, rig.pose.T, rays)
    error = reprojection_errors_of_rays(rig.pose.R, rig.pose.T, rays, rig.pixel_scale).mean(axis=1)
    sigma_px = noise_of_file(rig)[0] if sigma_px is None else sigma_px
    covariances = None if sigma_px is None else errors_of_pairs(rig, xyz, sigma_px).covariances
    return Points3D.in_frame(world, rig.volume, xyz, error, covariances)


def noise_of_file(rig: RigParameters) -> tuple[float | None, FloatArray | None]:
    """Image noise (px) and covariance (33, 33) of the unknowns of `views` of a file, else None."""
    stored = rig.uncertainties
    if not stored:
        return None, None
    try:
        found = covariance_of_entry(stored["covariance"], rig)
        return float(stored["sigma_px"]["value"]), found
    except (KeyError, TypeError, ValueError, IndexError) as error:
        raise StereocalError(
            f"The uncertainties of the parameter file cannot be read ({error})."
        ) from error


def errors_of_pairs(
    rig: RigParameters, points_m: FloatArray, sigma_px: float | FloatArray
) -> PointErrors:
    """Errors of points (n, 3) in the primary's frame, by the unknowns of `views`.

    Args:
        sigma_px: of all points, or (n, 2).
    """
    if not (np.isfinite(sigma_px).all() and np.min(sigma_px, initial=0.0) >= 0):
        raise StereocalError(f"The image noise is {sigma_px} px: it must be 0 or more.")
    errors = point_errors(rig_at(rig), sigma_px, points_m)
    of_parameters = noise_of_file(rig)[1]
    if of_parameters is None:
        return PointErrors(*errors, np.zeros((OF_PAIR, OF_PAIR)))
    # In units of the standard errors: an entry near 0 is not known to 1e-6 of itself.
    scale = np.sqrt(np.abs(np.diag(of_parameters)))
    uneven = np.abs(of_parameters - of_parameters.T)
    if (uneven > 1e-6 * np.outer(scale, scale)).any():
        raise StereocalError("The covariance in the parameter file is not symmetric.")
    return PointErrors(*errors, (of_parameters + of_parameters.T) / 2)


def name_of_world(world: Pose) -> str:
    """A name that tells this world frame from others: the start of a digest of its pose."""
    numbers = np.column_stack([world.R, world.T]).astype("<f8").tobytes()
    return f"world-{hashlib.sha256(numbers).hexdigest()[:8]}"
