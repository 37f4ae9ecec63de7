"""Two cameras and their pose: triangulation, residuals, epipolar distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import (
    Pose,
    epipolar_distances,
    reprojection_errors_of_rays,
    residuals,
    stack_rays,
    triangulate,
)


@dataclass(frozen=True, eq=False)
class Rig:
    """Two cameras and their pose."""

    primary: Camera
    secondary: Camera
    pose: Pose
    """`secondary_from_primary`."""

    def reconstruct(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> FloatArray:
        """Points (n, 3) in metres in the primary frame, from raw pixels (n, 2) of each camera."""
        return triangulate(
            self.pose, self.primary.undistort(primary_px), self.secondary.undistort(secondary_px)
        )

    def reprojection_errors(
        self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike
    ) -> FloatArray:
        """Errors (n, 2) in pixels of the undistorted images, from raw pixels of each camera."""
        rays = stack_rays(
            self.primary.undistort(primary_px), self.secondary.undistort(secondary_px)
        )
        scale = np.array([self.primary.pixel_scale, self.secondary.pixel_scale])
        return reprojection_errors_of_rays(self.pose.R, self.pose.T, rays, scale)

    def residuals(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> FloatArray:
        """`q_secondary^T E q_primary` (n,), from raw pixels (n, 2) of each camera."""
        return residuals(
            self.pose.essential,
            self.primary.undistort(primary_px),
            self.secondary.undistort(secondary_px),
        )

    def epipolar_errors(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> FloatArray:
        """Signed distance of each pair from its epipolar lines, (n,) undistorted pixels.

        To first order (Sampson): the residual over its standard deviation if each pixel coordinate
        has one of 1.

        Args:
            primary_px, secondary_px: raw pixels (n, 2) of each camera.
        """
        residual, gradient = self._sampson(primary_px, secondary_px)
        return np.asarray(residual / np.linalg.norm(gradient, axis=1))

    def epipolar_residuals(
        self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike
    ) -> FloatArray:
        """The smallest shifts (n, 4) of both points of a pair off their epipolar lines, to first
        order: u, v in the primary and in the secondary; their lengths are the `epipolar_errors`.
        """
        residual, gradient = self._sampson(primary_px, secondary_px)
        return np.asarray(gradient * (residual / np.square(gradient).sum(axis=1))[:, None])

    def _sampson(
        self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike
    ) -> tuple[FloatArray, FloatArray]:
        """The residuals (n,) and their derivatives (n, 4) by undistorted pixels."""
        E, n = self.pose.essential, len(np.asarray(primary_px))
        one = np.column_stack([self.primary.undistort(primary_px), np.ones(n)])
        two = np.column_stack([self.secondary.undistort(secondary_px), np.ones(n)])
        focal = [np.diag(camera.K)[:2] for camera in (self.primary, self.secondary)]
        gradient = np.column_stack([(two @ E)[:, :2] / focal[0], (one @ E.T)[:, :2] / focal[1]])
        residual = np.sum(two * (one @ E.T), axis=1)
        return residual, gradient

    def epipolar_distances(
        self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike
    ) -> FloatArray:
        """Distance of each point to the epipolar line of its partner, (n, 2) undistorted pixels.

        Args:
            primary_px, secondary_px: raw pixels (n, 2) of each camera.
        """
        F = np.linalg.inv(self.secondary.K).T @ self.pose.essential @ np.linalg.inv(self.primary.K)
        return epipolar_distances(
            F,
            self.primary.undistort_to_pixels(primary_px),
            self.secondary.undistort_to_pixels(secondary_px),
        )
