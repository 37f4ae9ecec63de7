"""The fisheye lens of Kannala and Brandt (2006), compiled.

A point at the angle t from the axis is imaged at the radius t (1 + k1 t^2 + k2 t^4 + k3 t^6 +
k4 t^8) from the principal point, in focal lengths. It is OpenCV's `fisheye`, Kalibr's `equi` and
ROS's `equidistant`. Points are (x, y) on the plane z = 1, as with every lens.
"""

from typing import Any

import numpy as np

from stereocal.rig.compiled import compiled, inlined
from stereocal.system.array_types import FloatArray

LARGEST_ANGLE = np.radians(75.0)
"""From the axis: half of the largest field of view. At 75 degrees a pixel on the plane z = 1 is 15
times as large as on the axis."""
INVERTED_ANGLE = np.radians(80.0)
"""To which a lens is inverted: one that a fit has moved within its errors sees a point farther out
than the stated lens. (With 75 degrees for both, the errors of such points were NaN.)"""
SAMPLES = 301
MAXIMUM_ITERATIONS = 60


@inlined
def image_radius(angle: Any, k1: float, k2: float, k3: float, k4: float) -> tuple[Any, Any]:
    """The radius in the image of an angle from the axis, or of an array of them, and its
    derivative."""
    tt = angle * angle
    radius = angle * (1.0 + tt * (k1 + tt * (k2 + tt * (k3 + tt * k4))))
    slope = 1.0 + tt * (3.0 * k1 + tt * (5.0 * k2 + tt * (7.0 * k3 + tt * 9.0 * k4)))
    return radius, slope


def largest_angle(coefficients: FloatArray) -> float:
    """The angle to which the image radius increases, at most `INVERTED_ANGLE`."""
    angles = np.linspace(0.0, INVERTED_ANGLE, SAMPLES)
    _, slope = image_radius(angles, *coefficients)
    falls = np.flatnonzero(slope <= 0.0)
    return float(angles[falls[0] - 1]) if len(falls) else float(INVERTED_ANGLE)


@compiled
def distort_fisheye(
    x: float, y: float, k1: float, k2: float, k3: float, k4: float
) -> tuple[float, float, float, float, float, float]:
    """The imaged point (x', y') of a point, and dx'/dx, dx'/dy, dy'/dx, dy'/dy."""
    rr = x * x + y * y
    r = np.sqrt(rr)
    if r < 1e-9:
        return x, y, 1.0, 0.0, 0.0, 1.0
    radius, slope = image_radius(np.arctan(r), k1, k2, k3, k4)
    scale = radius / r
    change = (slope / (1.0 + rr) - scale) / rr
    across = change * x * y
    return scale * x, scale * y, scale + change * x * x, across, across, scale + change * y * y


@compiled
def fisheye_derivatives(x: float, y: float, by_lens: FloatArray) -> None:
    """Write the derivatives of the imaged point by k1, k2, k3, k4 to `by_lens` (2, 4)."""
    r = np.sqrt(x * x + y * y)
    angle = np.arctan(r)
    power = angle / r if r > 1e-9 else 1.0
    for i in range(4):
        power *= angle * angle
        by_lens[0, i], by_lens[1, i] = power * x, power * y


@compiled
def imaged_shift(
    ax: float, ay: float, bx: float, by: float, scale: FloatArray, camera: int
) -> float:
    """The distance of the images of two points, in pixels.

    Args:
        scale: (c, 2, 4): `camera.pixel_scales`.
    """
    ax, ay = _imaged(ax, ay, scale[camera])
    bx, by = _imaged(bx, by, scale[camera])
    u = scale[camera, 0, 0] * (ax - bx) + scale[camera, 0, 1] * (ay - by)
    v = scale[camera, 0, 2] * (ay - by)
    distance: float = np.sqrt(u * u + v * v)
    return distance


@compiled
def _imaged(x: float, y: float, scale: FloatArray) -> tuple[float, float]:
    """The imaged point of a point; the point itself where the lens is no fisheye.

    The radius continues linearly beyond the largest angle of the lens: it never falls again, by
    which a wrong pair might look right.
    """
    largest = scale[0, 3]
    if largest == 0.0:
        return x, y
    r = np.sqrt(x * x + y * y)
    angle = np.arctan(r)
    radius, _ = image_radius(
        min(angle, largest), scale[1, 0], scale[1, 1], scale[1, 2], scale[1, 3]
    )
    radius += max(angle - largest, 0.0)
    stretch = radius / r if r > 1e-9 else 1.0
    return stretch * x, stretch * y


@compiled
def fill_distorted(
    points: FloatArray, k: FloatArray, distorted: FloatArray, jacobians: FloatArray
) -> None:
    """Write the imaged points (n, 2) of points (n, 2), and their Jacobians (n, 2, 2)."""
    for i in range(len(points)):
        u, v, xx, xy, yx, yy = distort_fisheye(points[i, 0], points[i, 1], k[0], k[1], k[2], k[3])
        distorted[i, 0], distorted[i, 1] = u, v
        jacobians[i, 0, 0], jacobians[i, 0, 1] = xx, xy
        jacobians[i, 1, 0], jacobians[i, 1, 1] = yx, yy


@compiled
def fill_undistorted(
    distorted: FloatArray, k: FloatArray, largest: float, points: FloatArray
) -> None:
    """Write the points (n, 2) of imaged points (n, 2); NaN beyond the angle `largest`.

    Newton's method for the angle, within bounds that enclose it.
    """
    edge, _ = image_radius(largest, k[0], k[1], k[2], k[3])
    for i in range(len(distorted)):
        x, y = distorted[i, 0], distorted[i, 1]
        r = np.sqrt(x * x + y * y)
        if not r <= edge:
            points[i, 0] = points[i, 1] = np.nan
            continue
        low, high, angle = 0.0, largest, min(r, largest)
        for _ in range(MAXIMUM_ITERATIONS):
            radius, slope = image_radius(angle, k[0], k[1], k[2], k[3])
            if radius > r:
                high = angle
            else:
                low = angle
            step = (radius - r) / slope
            following = angle - step
            if not low <= following <= high:
                following = 0.5 * (low + high)
            if abs(following - angle) < 1e-15:
                break
            angle = following
        stretch = np.tan(angle) / r if r > 1e-9 else 1.0
        points[i, 0], points[i, 1] = stretch * x, stretch * y
