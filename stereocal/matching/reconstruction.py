"""Reconstruct 3D points from matched pairs, with reprojection errors and standard errors."""

import hashlib
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.errors.uncertainty import point_errors
from stereocal.fit.least_squares.small_steps import cameras_at, rig_at
from stereocal.fit.parameter_file import covariance_of_entry
from stereocal.fit.rig_file import Parameters, RigFile
from stereocal.rig.geometry import Pose, reprojection_errors_of_rays, stack_rays, triangulate_rays
from stereocal.rig.parameters import RigParameters
from stereocal.rig.volume import Volume
from stereocal.system.array_types import BoolArray, FloatArray

Noise = float | FloatArray | None
"""Of an image coordinate, of all points or (n, 2) of each in two cameras; None: 1 px."""


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


@dataclass(frozen=True, eq=False)
class Measured:
    """Points of n groups of views."""

    xyz: FloatArray
    """(n, 3): metres, in the reference's frame; NaN where there is no point."""
    error_px: FloatArray
    """(n,): mean distance of the images from those of the point."""
    errors: PointErrors
    """Without a noise of the images for one of 1 px, and without derivatives."""
    chi_square: FloatArray
    """(n,): of the pixels, for noise of 1 px; 0 for points of two views by their midpoint."""

    def in_frame(self, world: Pose | None, volume: Volume | None, with_errors: bool) -> Points3D:
        """The points in a frame.

        Args:
            world: `world_from_reference`; None: that of the reference.
            with_errors: those of its parameters are common to all points: distances between points
                are more precise than their positions.
        """
        xyz = self.xyz if world is None else world.apply(self.xyz)
        outside, sigma = None if volume is None else ~volume.contains(self.xyz), None
        if with_errors:
            R = np.eye(3) if world is None else world.R
            sigma = np.sqrt(np.einsum("nii->ni", R @ self.errors.covariances @ R.T))
        return Points3D(xyz, self.error_px, sigma, outside)


def midpoints(rig: RigParameters, pixels: FloatArray, sigma_px: Noise) -> Measured:
    """The midpoints of the rays of pairs, raw pixels (n, 2, 2)."""
    R, T = rig.pose.R, rig.pose.T
    if rig.has_windows:
        xyz = rig.reconstruct(pixels[:, 0], pixels[:, 1])
        both = rig.reprojection_errors(pixels[:, 0], pixels[:, 1])
    else:
        rays = stack_rays(rig.primary.rays_of(pixels[:, 0]), rig.secondary.rays_of(pixels[:, 1]))
        xyz = triangulate_rays(R, T, rays)
        both = reprojection_errors_of_rays(R, T, rays, rig.pixel_scale)
    errors = errors_of_pairs(rig, xyz, 1.0 if sigma_px is None else sigma_px)
    return Measured(xyz, both.mean(axis=1), errors, np.zeros(len(xyz)))


def noise_of_file(rig: RigParameters) -> tuple[float | None, FloatArray | None]:
    """Image noise (px) and covariance (Q, Q) of the unknowns of `views` of a file, else None."""
    stored = rig.uncertainties
    if not stored:
        return None, None
    try:
        covariance = _with_windows(covariance_of_entry(stored["covariance"], rig), rig)
        return float(stored["sigma_px"]["value"]), covariance
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
    return PointErrors(*errors, covariance_of(rig))


def covariance_of(rig: Parameters) -> FloatArray:
    """(Q, Q): of the unknowns of `views`; 0 where a parameter file does not state it."""
    if isinstance(rig, RigFile):
        return _with_windows(rig.covariance, rig)
    if (covariance := noise_of_file(rig)[1]) is None:
        return np.zeros(2 * (len(rig_at(rig).q),))
    # In units of the standard errors: an entry near 0 is not known to 1e-6 of itself.
    scale = np.sqrt(np.abs(np.diag(covariance)))
    if (np.abs(covariance - covariance.T) > 1e-6 * np.outer(scale, scale)).any():
        raise StereocalError("The covariance in the parameter file is not symmetric.")
    return np.asarray((covariance + covariance.T) / 2)


def _with_windows(covariance: FloatArray, rig: Parameters) -> FloatArray:
    """(Q, Q): a covariance of the unknowns of `views`; one without those of windows, which stand
    before the last, with windows that are known exactly."""
    cameras, poses = zip(*rig.placed.values(), strict=True)
    missing = len(cameras_at(cameras, poses).q) - len(covariance)
    if missing:
        last = (len(covariance) - 1,) * missing
        covariance = np.insert(np.insert(covariance, last, 0.0, axis=0), last, 0.0, axis=1)
    return covariance


def name_of_world(world: Pose) -> str:
    """A name that tells this world frame from others: the start of a digest of its pose."""
    numbers = np.column_stack([world.R, world.T]).astype("<f8").tobytes()
    return f"world-{hashlib.sha256(numbers).hexdigest()[:8]}"
