"""How well the refined set is known, and what it measures: standard errors, and errors by place.

The midpoint of two rays is the point X of least sum of squared distances to them. Where camera c
has the slopes J_c (2, 3) of its pixels by X, a change du of the pixels, or dq of the cameras,
shifts its ray near X by J_c^+ (du - J_q dq), square to the ray, and the midpoint by N^-1 times the
sum of both shifts, N = sum of J_c^+ J_c. So the error of a point has two parts: that of its own
pixels, and that of the cameras, which all points share.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from stereocal.errors import StereocalError
from stereocal.refined.adjustment import point_slopes
from stereocal.refined.bar_fit import BASELINE, PRIMARY, SECONDARY, SHARED
from stereocal.refined.refine import RefinedResult
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import BoolArray, FloatArray

LENS = ("fx", "fy", "cx", "cy")


@dataclass(frozen=True)
class Value:
    """An estimate with its standard error; 0 for a number that was held fixed."""

    value: float
    sigma: float


def standard_errors(result: RefinedResult) -> dict[str, Value]:
    """The five angles in radians, `baseline_m`, and fx, fy, cx, cy of each camera in pixels."""
    sigma = np.sqrt(np.diag(result.covariance))
    names = [*result.pose.angles._fields, "baseline_m"]
    places = [*range(5), BASELINE]
    for name, at in (("primary", PRIMARY), ("secondary", SECONDARY)):
        names += [f"{name}_{key}" for key in LENS]
        places += range(at, at + 4)
    return {
        name: Value(float(result.q[at]), float(sigma[at]))
        for name, at in zip(names, places, strict=True)
    }


def point_covariances(result: RefinedResult, points_m: npt.ArrayLike) -> FloatArray:
    """(n, 3, 3), in square metres: of reconstructed points at (n, 3) in the primary's frame.

    Own noise of the pixels and error of the cameras together. NaN behind a camera.
    """
    own, moves = _point_errors(result, points_m)
    return np.asarray(own + moves @ result.covariance @ moves.transpose(0, 2, 1))


def distance_sigmas(
    result: RefinedResult, first_m: npt.ArrayLike, second_m: npt.ArrayLike
) -> FloatArray:
    """(n,), in metres: standard errors of reconstructed distances between (n, 3) and (n, 3) points.

    NaN behind a camera.
    """
    along, own, slopes = _length_errors(result, first_m, second_m)
    variance = np.einsum("ni,nij,nj->n", along, own, along)
    variance += np.einsum("ni,ij,nj->n", slopes, result.covariance, slopes)
    return np.asarray(np.sqrt(variance))


def length_slopes(
    result: RefinedResult, first_m: npt.ArrayLike, second_m: npt.ArrayLike
) -> FloatArray:
    """(n, 15): slopes of reconstructed distances by the shared unknowns of `bar_fit`."""
    return _length_errors(result, first_m, second_m)[2]


def _length_errors(
    result: RefinedResult, first_m: npt.ArrayLike, second_m: npt.ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Direction (n, 3) of each distance, covariance (n, 3, 3) of its ends' difference, slopes."""
    a, b = (np.asarray(points, dtype=np.float64) for points in (first_m, second_m))
    along = (a - b) / np.linalg.norm(a - b, axis=1, keepdims=True)
    own_a, moves_a = _point_errors(result, a)
    own_b, moves_b = _point_errors(result, b)
    return along, own_a + own_b, np.einsum("ni,nij->nj", along, moves_a - moves_b)


@dataclass(frozen=True, eq=False)
class AccuracyMap:
    """Predicted errors on the plane y = 0 of the primary's frame; NaN out of a camera's view."""

    x_m: FloatArray
    """(i,)."""
    z_m: FloatArray
    """(j,)."""
    point_m: FloatArray
    """(j, i): root of the sum of the three variances of a point."""
    distance: FloatArray
    """(j, i): error of a distance as long as the bar, as a fraction, mean over three directions."""


def accuracy_map(result: RefinedResult, size: int = 60) -> AccuracyMap:
    """How accurate the rig is, by place, from the cameras to beyond the farthest bar.

    Raises:
        StereocalError: fewer than 2 places a side.
    """
    if size < 2:
        raise StereocalError("The map needs at least 2 places a side.")
    ends = result.places_m[~result.outlying].reshape(-1, 3)
    ends = ends[np.isfinite(ends).all(axis=1)]
    far = 1.2 * float(ends[:, 2].max())
    half = 1.2 * float(np.abs(ends[:, 0]).max())
    x, z = np.linspace(-half, half, size), np.linspace(far / size, far, size)
    places = np.stack([*np.meshgrid(x, z)], axis=-1).reshape(-1, 2)
    points = np.column_stack([places[:, 0], np.zeros(len(places)), places[:, 1]])
    seen = in_view(result.primary, points) & in_view(result.secondary, result.pose.apply(points))
    point, distance = np.full(len(points), np.nan), np.full(len(points), np.nan)
    if seen.any():
        covariances = point_covariances(result, points[seen])
        point[seen] = np.sqrt(np.trace(covariances, axis1=1, axis2=2))
        length = result.dataset.target_distance_m
        sigmas = [
            distance_sigmas(result, points[seen] - half_bar, points[seen] + half_bar)
            for half_bar in 0.5 * length * np.eye(3)
        ]
        distance[seen] = np.mean(sigmas, axis=0) / length
    shape = (len(z), len(x))
    return AccuracyMap(x, z, point.reshape(shape), distance.reshape(shape))


def in_view(camera: Camera, points_m: FloatArray) -> BoolArray:
    """(n,): which points of the camera's own frame lie in its image."""
    pixels = camera.project(points_m)
    with np.errstate(invalid="ignore"):
        size = np.array(camera.image_size)
        inside = np.asarray(((pixels >= -0.5) & (pixels <= size - 0.5)).all(axis=1))
        # Far outside the view a lens polynomial can turn back and put a point into the image.
        seen = np.flatnonzero(inside)
        rays = points_m[seen, :2] / points_m[seen, 2:]
        inside[seen] = np.abs(camera.undistort(pixels[seen]) - rays).max(axis=1, initial=0) < 1e-6
    return inside


def _point_errors(result: RefinedResult, points_m: npt.ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Covariances (n, 3, 3) from the pixels, and moves (n, 3, 15) by the shared unknowns."""
    points = np.ascontiguousarray(points_m, dtype=np.float64).reshape(-1, 3)
    slopes = np.empty((len(points), 3 + SHARED, 4))
    point_slopes(result.q, result.lenses, 1 / result.sigma_px.value, points, slopes)
    by_place, by_cameras = slopes[:, :3].transpose(0, 2, 1), slopes[:, 3:].transpose(0, 2, 1)
    usable = np.asarray(np.isfinite(by_place).all(axis=(1, 2)))
    own = np.full((len(points), 3, 3), np.nan)
    moves = np.full((len(points), 3, SHARED), np.nan)
    of_both = by_place[usable]
    shifts = np.concatenate(
        [np.linalg.pinv(of_both[:, :2]), np.linalg.pinv(of_both[:, 2:])], axis=2
    )
    gain = np.linalg.solve(shifts @ of_both, shifts)
    own[usable] = gain @ gain.transpose(0, 2, 1)
    moves[usable] = -gain @ by_cameras[usable]
    return own, moves
