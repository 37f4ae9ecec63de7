"""Standard errors of the refined set, and of the points and distances that it reconstructs.

The midpoint of two rays is the point X with the least sum of squared distances to them. Let J_c
(2, 3) be the Jacobian of camera c's pixels by X. A change du of the pixels, or dq of the
unknowns, shifts the ray near X by J_c^+ (du - J_q dq), perpendicular to the ray, and the midpoint
by N^-1 times the sum of both shifts, N = sum of J_c^+ J_c. The error of a point therefore has two
parts: one from the noise of its pixels, one from the cameras, which all points share.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.small_steps import window_places
from stereocal.fit.least_squares.views import EACH, Cameras, jacobians_of
from stereocal.fit.refined_result import RefinedResult
from stereocal.system.array_types import BoolArray, FloatArray, IntArray

MEAN_OF_NORMAL = float(np.sqrt(2 / np.pi))
"""Mean absolute value over standard deviation of a normal error."""
Plane = Literal["above", "side"]


def point_covariances(result: RefinedResult, points_m: npt.ArrayLike) -> FloatArray:
    """Covariances of reconstructed points, (n, 3, 3) in square metres; NaN behind a camera.

    They include the noise of the points' own pixels and the errors of the cameras.

    Args:
        points_m: (n, 3), in the primary's frame.
    """
    of_pixels, jacobian = point_errors(result.at, result.sigma_px.value, points_m)
    return np.asarray(of_pixels + jacobian @ result.covariance @ jacobian.transpose(0, 2, 1))


def length_sigmas(
    cameras: Cameras,
    sigma_px: float,
    covariance: FloatArray,
    first_m: npt.ArrayLike,
    second_m: npt.ArrayLike,
) -> FloatArray:
    """Standard errors (n,) of reconstructed distances, in metres; NaN behind a camera.

    Args:
        covariance: (Q, Q); the others as in `point_errors`.
        first_m, second_m: (n, 3) each, in the primary's frame.
    """
    of_pixels, jacobian = length_variances(cameras, sigma_px, first_m, second_m)
    return np.asarray(np.sqrt(of_pixels + np.einsum("ni,ni->n", jacobian @ covariance, jacobian)))


def length_variances(
    cameras: Cameras, sigma_px: float, first_m: npt.ArrayLike, second_m: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Variances (n,) of distances from the noise of their pixels, and derivatives (n, Q) of the
    distances by the unknowns of `views`; arguments as in `point_errors`.
    """
    a, b = (np.asarray(points, dtype=np.float64) for points in (first_m, second_m))
    along = (a - b) / np.linalg.norm(a - b, axis=1, keepdims=True)
    covariance_a, jacobian_a = point_errors(cameras, sigma_px, a)
    covariance_b, jacobian_b = point_errors(cameras, sigma_px, b)
    of_pixels = np.einsum("ni,nij,nj->n", along, covariance_a + covariance_b, along)
    return of_pixels, np.einsum("ni,nij->nj", along, jacobian_a - jacobian_b)


@dataclass(frozen=True, eq=False)
class AccuracyMap:
    """Predicted errors on a plane of the primary's frame; NaN outside a camera's view."""

    plane: Plane
    """`above`: the plane y = `at_m`; `side`: the plane x = `at_m`."""
    at_m: float
    across_m: FloatArray
    """(i,): x seen from above, y seen from the side."""
    z_m: FloatArray
    """(j,)."""
    point_m: FloatArray
    """(j, i): standard error of a point: root of the sum of its three variances, in metres."""
    distance: FloatArray
    """(j, i): relative standard error of a distance of the bar's length, mean over the directions
    x, y and z."""


def accuracy_map(result: RefinedResult, size: int = 60, plane: Plane = "above") -> AccuracyMap:
    """Predicted errors from the cameras to beyond the farthest bar, on a grid of `size` x `size`.

    The plane is at the height of the primary camera, or upright through the middle of the bars.
    """
    if size < 2:
        raise StereocalError(f"The accuracy map needs at least 2 points per side, not {size}.")
    ends = result.used_points_m.reshape(-1, 3)
    ends = ends[np.isfinite(ends).all(axis=1)]
    axis = 0 if plane == "above" else 1
    at_m = 0.0 if plane == "above" else float(np.median(ends[:, 0]))
    far = 1.2 * float(ends[:, 2].max())
    half = 1.2 * float(np.abs(ends[:, axis]).max())
    across, z = np.linspace(-half, half, size), np.linspace(far / size, far, size)
    points = np.full((size * size, 3), at_m)
    points[:, [axis, 2]] = np.stack([*np.meshgrid(across, z)], axis=-1).reshape(-1, 2)
    seen = result.primary.sees(points) & result.secondary.sees(result.pose.apply(points))
    point, distance = np.full(len(points), np.nan), np.full(len(points), np.nan)
    if seen.any():
        covariances = point_covariances(result, points[seen])
        point[seen] = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
        length, noise = result.dataset.target_distance_m, float(result.sigma_px.value)
        known = result.at, noise, result.covariance
        sigmas = [
            length_sigmas(*known, points[seen] - half_bar, points[seen] + half_bar)
            for half_bar in 0.5 * length * np.eye(3)
        ]
        distance[seen] = np.mean(sigmas, axis=0) / length
    shape = (size, size)
    return AccuracyMap(plane, at_m, across, z, point.reshape(shape), distance.reshape(shape))


def point_errors(
    cameras: Cameras, sigma_px: float | FloatArray, points_m: npt.ArrayLike
) -> tuple[FloatArray, FloatArray]:
    """Covariances (n, 3, 3) of points from the noise of their pixels, and derivatives (n, 3, Q)
    of the points by the unknowns of `views`; NaN behind a camera.

    A change du of the pixels or dq of the unknowns moves the midpoint by N^-1 times the sum of
    J_c^+ (du_c - J_q,c dq), N the sum of J_c^+ J_c (docs/refined.md, *Uncertainty*).

    Args:
        cameras: two of them.
        sigma_px: standard deviation of a pixel coordinate, of all points or (n, 2) of each point in
            both cameras.
        points_m: (n, 3), in the primary's frame.
    """
    points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 3)
    by_point, by_shared = point_jacobians(cameras, points)
    usable = np.asarray(np.isfinite(by_point).all(axis=(1, 2)))
    of_pixels = np.full((len(points), 3, 3), np.nan)
    jacobian = np.full((len(points), 3, len(cameras.q)), np.nan)
    J = by_point[usable]
    of_cameras = J.reshape(-1, 2, 2, 3)
    # J_c^+ = J_c^T (J_c J_c^T)^-1, in a fifth of the time of `pinv`.
    pseudo_inverse_T = np.linalg.solve(of_cameras @ of_cameras.transpose(0, 1, 3, 2), of_cameras)
    shifts = pseudo_inverse_T.reshape(-1, 4, 3).transpose(0, 2, 1)
    gain = np.linalg.solve(shifts @ J, shifts)
    sigmas = np.broadcast_to(np.asarray(sigma_px, dtype=np.float64), (len(points), 2))[usable]
    weighted = gain * np.repeat(sigmas, 2, axis=1)[:, None, :]
    of_pixels[usable] = weighted @ weighted.transpose(0, 2, 1)
    jacobian[usable] = -gain @ by_shared[usable]
    return of_pixels, jacobian


def point_jacobians(cameras: Cameras, points_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Derivatives of the pixels of points (n, 3) in two cameras by the points (n, 4, 3) and by the
    unknowns of `views` (n, 4, Q); NaN behind a camera."""
    n = len(points_m)
    by_point, by_views = jacobians_of(cameras, points_m)
    by_unknown = np.zeros((n, 4, len(cameras.q)))
    for camera in range(2):
        of_camera = by_unknown[:, 2 * camera : 2 * camera + 2]
        of_camera[..., EACH * camera : EACH * (camera + 1)] = by_views[:, camera, :, :EACH]
        if len(cameras.windows):
            of_camera[..., window_places(camera, 2)] = by_views[:, camera, :, EACH:]
    return by_point.reshape(n, 4, 3), by_unknown


@dataclass(frozen=True)
class Innovations:
    """The lengths of bars from pixels alone, of each frame or part of one; NaN without a bar."""

    frames: IntArray
    """(f,)."""
    errors_m: FloatArray
    """(f,): length from the pixels alone minus the stated length."""
    variances_m2: FloatArray
    """(f,): its variance from the noise of the pixels."""
    points_m: FloatArray
    """(f, 2, 3): the points, fitted to the pixels alone."""
    of_pixels: FloatArray
    """(Q, Q): information matrix of the pixels alone."""


def bar_innovations(result: RefinedResult, rows: BoolArray) -> Innovations:
    """The lengths of bars with a refined set.

    Args:
        rows: mask (n,) of the rows of the data set; they need not be those that were fitted.
    """
    solve = result.fit_of(result.dataset, rows)
    n = len(solve.points)
    _, H, _ = solve.sum_at(0.0, np.full(n, np.inf), solve.points, np.empty(n))
    errors, variances = solve.innovations(solve.points).T
    frames = solve.frames[solve.frame_of]
    return Innovations(frames, errors, variances, solve.points.reshape(n, 2, 3), H)


def length_freedom(result: RefinedResult, bars: Innovations) -> float:
    """Degrees of freedom of the lengths that the fit has absorbed."""
    M = result.unknowns.M
    of_lengths = M.T @ (result.information - bars.of_pixels) @ M
    return max(float(np.sum(result.p_covariance_by_model * of_lengths)), 0.0)
