"""Two cameras and their pose: triangulation, residuals, epipolar distances."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
import numpy.typing as npt

from stereocal.rig.camera import CAMERAS, Camera, pixel_scales
from stereocal.rig.geometry import (
    AT_ORIGIN,
    Pose,
    apart_m,
    homogeneous,
    midpoints,
    reprojection_errors_of_rays,
    residuals,
    stack_rays,
    triangulate,
)
from stereocal.system.array_types import FloatArray

Rays = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
"""Origins and unit directions (n, 3) of one camera's rays, and of another's."""
STEP_PX = 0.25
"""Of differences by pixels."""


class PlacedCamera(NamedTuple):
    """A camera and where it is."""

    camera: Camera
    pose: Pose
    """`camera_from_reference`."""

    @classmethod
    def from_json(cls, data: Mapping[str, Any], name: str) -> "PlacedCamera":
        """The inverse of `to_json`; `name` is for messages."""
        return cls(Camera.from_json(data, name), Pose.from_json(data))

    def to_json(self) -> dict[str, Any]:
        """The entries of the camera and of the pose."""
        return {**self.camera.to_json(), **self.pose.to_json()}


@runtime_checkable
class PlacedCameras(Protocol):
    """Two cameras or more."""

    @property
    def placed(self) -> Mapping[str, PlacedCamera]:
        """The cameras by name; the first is the reference."""


@dataclass(frozen=True)
class SeveralCameras:
    """Cameras and their poses."""

    placed: Mapping[str, PlacedCamera]


@dataclass(frozen=True, eq=False)
class Rig:
    """Two cameras and their pose."""

    primary: Camera
    secondary: Camera
    pose: Pose
    """`secondary_from_primary`."""

    @property
    def placed(self) -> dict[str, PlacedCamera]:
        """The primary, which is the reference, and the secondary."""
        cameras, poses = (self.primary, self.secondary), (AT_ORIGIN, self.pose)
        return dict(zip(CAMERAS, map(PlacedCamera, cameras, poses), strict=True))

    def reconstruct(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> FloatArray:
        """Points (n, 3) in metres in the primary frame, from raw pixels (n, 2) of each camera."""
        if self.has_windows:
            return midpoints(*self.rays_between(primary_px, secondary_px))
        return triangulate(
            self.pose, self.primary.undistort(primary_px), self.secondary.undistort(secondary_px)
        )

    def reprojection_errors(
        self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike
    ) -> FloatArray:
        """Errors (n, 2) in pixels as of `Camera`, from raw pixels (n, 2) of each camera."""
        if self.has_windows:
            points = self.reconstruct(primary_px, secondary_px)
            return self.image_errors(points, primary_px, secondary_px)
        rays = stack_rays(
            self.primary.undistort(primary_px), self.secondary.undistort(secondary_px)
        )
        return reprojection_errors_of_rays(self.pose.R, self.pose.T, rays, self.pixel_scale)

    def image_errors(
        self, points: FloatArray, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike
    ) -> FloatArray:
        """Distances (n, 2) of the images of points (n, 3) from raw pixels (n, 2) of each camera."""
        images = self.primary.project(points), self.secondary.project(self.pose.apply(points))
        seen = (primary_px, secondary_px)
        apart = [np.subtract(image, px) for image, px in zip(images, seen, strict=True)]
        return np.asarray(np.linalg.norm(np.stack(apart, axis=1), axis=2))

    @property
    def has_windows(self) -> bool:
        """Whether a camera looks through a window: then there is no essential matrix, and errors
        are in pixels of the recorded image."""
        return self.primary.window is not None or self.secondary.window is not None

    def rays_between(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> Rays:
        """Origins and directions (n, 3) of the primary's rays, and of the secondary's, in the
        primary's frame."""
        back, rays = self.pose.inverse(), list[FloatArray]()
        for camera, px in ((self.primary, primary_px), (self.secondary, secondary_px)):
            origins, directions = camera.rays_from(px)
            rays += [origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)]
        return rays[0], rays[1], back.apply(rays[2]), rays[3] @ back.R.T

    @property
    def pixel_scale(self) -> FloatArray:
        """`pixel_scales` of both cameras."""
        return pixel_scales((self.primary, self.secondary))

    def residuals(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> FloatArray:
        """`q_secondary^T E q_primary` (n,), from raw pixels (n, 2) of each camera; behind windows
        the distance of both rays, in metres."""
        if self.has_windows:
            return apart_m(*self.rays_between(primary_px, secondary_px))
        return residuals(
            self.pose.essential,
            self.primary.undistort(primary_px),
            self.secondary.undistort(secondary_px),
        )

    def epipolar_errors(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> FloatArray:
        """Signed distance of each pair from its epipolar lines, (n,) pixels as of `Camera`.

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
        """The residuals (n,) and their derivatives (n, 4) by the pixels in which errors are.

        Those behind windows are by central differences.
        """
        if self.has_windows:
            seen = np.column_stack([np.asarray(primary_px), np.asarray(secondary_px)])
            slopes = []
            for step in STEP_PX * np.eye(4):
                after, before = (np.hsplit(seen + way * step, 2) for way in (1.0, -1.0))
                change = self.residuals(*after) - self.residuals(*before)
                slopes.append(change / (2.0 * STEP_PX))
            return self.residuals(primary_px, secondary_px), np.column_stack(slopes)
        E = self.pose.essential
        p, q = self.primary.undistort(primary_px), self.secondary.undistort(secondary_px)
        one, two = homogeneous(p), homogeneous(q)
        gradient = np.column_stack(
            [
                _by_pixels(self.primary, p, (two @ E)[:, :2]),
                _by_pixels(self.secondary, q, (one @ E.T)[:, :2]),
            ]
        )
        residual = np.sum(two * (one @ E.T), axis=1)
        return residual, gradient

    def residual_slopes(self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike) -> FloatArray:
        """Derivatives (n, 4) of the `residuals` by u and v in the primary and in the secondary."""
        return self._sampson(primary_px, secondary_px)[1]

    def epipolar_distances(
        self, primary_px: npt.ArrayLike, secondary_px: npt.ArrayLike
    ) -> FloatArray:
        """Distance of each point to the epipolar line of its partner, (n, 2) pixels as of `Camera`.

        To first order for a fisheye, whose epipolar lines are curves.

        Args:
            primary_px, secondary_px: raw pixels (n, 2) of each camera.
        """
        residual, gradient = self._sampson(primary_px, secondary_px)
        lengths = np.linalg.norm(gradient.reshape(-1, 2, 2), axis=2)
        return np.asarray(np.abs(residual)[:, None] / lengths)


def _by_pixels(camera: Camera, rays: FloatArray, by_rays: FloatArray) -> FloatArray:
    """(n, 2): derivatives by pixels, from those by the points of z = 1."""
    if not camera.is_fisheye and not camera.K[0, 1]:
        return by_rays / np.diag(camera.K)[:2]
    jacobians = camera.pixel_jacobians(rays)
    lost = ~np.isfinite(jacobians).all(axis=(1, 2))
    jacobians[lost] = np.eye(2)
    by_pixels = np.linalg.solve(jacobians.transpose(0, 2, 1), by_rays[:, :, None])[:, :, 0]
    by_pixels[lost] = np.nan
    return np.asarray(by_pixels)
