"""How uncertain observations are: image noise, and errors of the parameters.

Errors of the parameters are common to all observations. They are written as `spread @ z` with z
independent and standard normal, so that an observation's change is first order in z.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from stereocal.errors import StereocalError
from stereocal.field.checking.prior import root_of
from stereocal.fit.errors.uncertainty import point_errors
from stereocal.fit.least_squares.small_steps import rig_at
from stereocal.matching.reconstruction import noise_of_file
from stereocal.rig.camera import Camera
from stereocal.rig.parameters import RigParameters
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray

ASSUMED_PX = 0.5
LARGEST_MISFIT = 0.05
"""Largest reprojection error over the image's diagonal; beyond it the images are not of one point,
or not of this rig."""


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Image noise, and errors of the parameters."""

    sigma_px: float
    """Standard deviation of an image coordinate."""
    source: Literal["stated", "parameter file", "assumed", "residuals"]
    spread: FloatArray
    """(Q, r): of the unknowns of `views`; r = 0 if the file states no covariance."""

    @property
    def entries(self) -> dict[str, Any]:
        """What `uncertainty` says of the observations and of the parameters."""
        known = "covariance of the parameter file"
        return {
            "level": 0.95,
            "noise_px": {"value": self.sigma_px, "source": self.source},
            "errors_of_parameters": known if self.spread.size else "unknown: image noise only",
        }


def error_model_of(rig: RigParameters, sigma_px: float | None = None) -> ErrorModel:
    """The noise stated, else that of the file, else `ASSUMED_PX`; parameter errors of the file."""
    if sigma_px is not None and not (np.isfinite(sigma_px) and sigma_px > 0):
        raise StereocalError(f"The image noise is {sigma_px} px; it must be above 0.")
    of_file, covariance = noise_of_file(rig)
    spread = np.zeros((len(rig_at(rig).q), 0)) if covariance is None else root_of(covariance)
    if sigma_px is not None:
        return ErrorModel(sigma_px, "stated", spread)
    known = of_file or rig.noise_px
    return ErrorModel(known or ASSUMED_PX, "parameter file" if known else "assumed", spread)


@dataclass(frozen=True, eq=False)
class MeasuredPoints:
    """Reconstructed points, in the primary's frame."""

    xyz: FloatArray
    """(n, 3) metres."""
    own: FloatArray
    """(n, 3, 3): covariance for an image noise of 1 px."""
    by_rig: FloatArray
    """(n, 3, r): derivatives by z."""


def measured_points(rig: Rig, xyz: FloatArray, spread: FloatArray) -> MeasuredPoints:
    covariances, jacobian = point_errors(rig_at(rig), 1.0, xyz)
    return MeasuredPoints(xyz, covariances, jacobian @ spread)


def tilt_jacobian(rig: Rig, up: FloatArray, places: FloatArray, spread: FloatArray) -> FloatArray:
    """(3, r): derivatives by z of the direction of reconstructed plumb lines, mean over places.

    The parameters' errors turn what is reconstructed there, and with it the vertical found from
    it. That is no error of the world frame, whose points are reconstructed alike.
    `up` is a unit vector (3,), the places are (n, 3), in the primary's frame.
    """
    half = 0.05 * np.linalg.norm(places, axis=1, keepdims=True)
    ends = [measured_points(rig, places + way * half * up, spread).by_rig for way in (1, -1)]
    by_rig = (ends[0] - ends[1]) / (2 * half[:, :, None])
    across = by_rig - np.einsum("i,j,njr->nir", up, up, by_rig)
    return np.asarray(np.nanmean(across, axis=0))


def usual_place(rig: RigParameters) -> FloatArray:
    """(1, 3): the middle of the bars' volume, or a place eight baselines away."""
    depth = 8.0 * rig.pose.baseline
    return np.array([[0.0, 0.0, depth if rig.volume is None else float(np.mean(rig.volume.z_m))]])


def reconstructed(rig: Rig, pixels: FloatArray, names: tuple[str, ...]) -> FloatArray:
    """Points (n, 3) of raw pixels (n, 4) with their names."""
    primary, secondary = pixels[:, :2], pixels[:, 2:]
    check_inside(primary, rig.primary, "primary", names)
    check_inside(secondary, rig.secondary, "secondary", names)
    xyz = rig.reconstruct(primary, secondary)
    error = rig.reprojection_errors(primary, secondary).mean(axis=1)
    far = LARGEST_MISFIT * float(np.hypot(*rig.primary.image_size))
    bad = np.flatnonzero(~np.isfinite(xyz).all(axis=1) | ~(error < far))
    if len(bad):
        away = error[bad[0]]
        how = f"miss each other by {away:.0f} px" if np.isfinite(away) else "do not meet"
        raise StereocalError(
            f"{names[bad[0]]}: the rays of its two images {how}; the two images are not of one "
            "point, or the parameters are not of these cameras."
        )
    return xyz


def check_inside(pixels: FloatArray, camera: Camera, side: str, names: tuple[str, ...]) -> None:
    """Check that raw pixels (n, 2) are inside their image."""
    for row, what in camera.outside(pixels):
        raise StereocalError(
            f"{names[row]}: the {side} {what}; are the parameters of these cameras?"
        )
