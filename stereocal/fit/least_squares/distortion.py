"""The lens models and their derivatives, compiled, for the refined method."""

import numpy as np

from stereocal.rig.camera import Camera
from stereocal.rig.compiled import compiled
from stereocal.rig.fisheye import distort_fisheye, fisheye_derivatives
from stereocal.system.array_types import FloatArray

TERMS = 22
"""k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4, 1 if the sensor is tilted else 0, and its 3x3 homography.
Of a fisheye: k1 k2 k3 k4, its largest angle, zeros, and `FISHEYE` at `TILTED`."""
TILTED = 12
FISHEYE = 2.0


def lens_terms(camera: Camera) -> FloatArray:
    """The distortion coefficients of a camera in the order of `TERMS`, shape (22,)."""
    terms = np.zeros(TERMS)
    known = camera.distortion
    if camera.is_fisheye:
        terms[:4], terms[4], terms[TILTED] = known, camera.largest_angle, FISHEYE
        return terms
    terms[: min(len(known), TILTED)] = known[:TILTED]
    tilt = np.eye(3)
    if len(known) > TILTED and known[TILTED:].any():
        terms[TILTED] = 1.0
        tilt = _tilt(*known[TILTED:])
    terms[TILTED + 1 :] = tilt.ravel()
    return terms


def lenses_of_cameras(*cameras: Camera) -> FloatArray:
    """(c, 23): skew and `lens_terms` of cameras."""
    return np.array([np.append(c.K[0, 1], lens_terms(c)) for c in cameras])


def _tilt(tau_x: float, tau_y: float) -> FloatArray:
    """The homography of a tilted sensor, (3, 3) (OpenCV, `computeTiltProjectionMatrix`)."""
    cx, sx, cy, sy = np.cos(tau_x), np.sin(tau_x), np.cos(tau_y), np.sin(tau_y)
    turn = np.array([[cy, 0.0, -sy], [0.0, 1.0, 0.0], [sy, 0.0, cy]]) @ np.array(
        [[1.0, 0.0, 0.0], [0.0, cx, sx], [0.0, -sx, cx]]
    )
    to_plane = np.array(
        [[turn[2, 2], 0.0, -turn[0, 2]], [0.0, turn[2, 2], -turn[1, 2]], [0.0, 0.0, 1.0]]
    )
    tilt: FloatArray = to_plane @ turn
    return tilt


@compiled
def distort(
    x: float, y: float, lenses: FloatArray, camera: int
) -> tuple[float, float, float, float, float, float]:
    """The distorted point (x', y') of a normalised point, and dx'/dx, dx'/dy, dy'/dx, dy'/dy.

    OpenCV's model (its documentation of `calib3d`), with rr = x^2 + y^2:

        radial = (1 + k1 rr + k2 rr^2 + k3 rr^3) / (1 + k4 rr + k5 rr^2 + k6 rr^3)
        u = x radial + 2 p1 x y + p2 (rr + 2 x^2) + s1 rr + s2 rr^2
        v = y radial + p1 (rr + 2 y^2) + 2 p2 x y + s3 rr + s4 rr^2

    and, of a tilted sensor, (x', y') is (u, v) after its homography (entries 13 to 21 of
    `lens_terms`, row by row); else (u, v) itself. `by_rr` is d radial / d rr, (a, b, c, d) are the
    derivatives of the homography.

    Args:
        lenses: (c, 23): of each camera the skew, which is not used here, and `lens_terms`.
    """
    terms = lenses[camera, 1:]
    if terms[12] == FISHEYE:
        return distort_fisheye(x, y, terms[0], terms[1], terms[2], terms[3])
    k1, k2, p1, p2, k3 = terms[0], terms[1], terms[2], terms[3], terms[4]
    k4, k5, k6 = terms[5], terms[6], terms[7]
    s1, s2, s3, s4 = terms[8], terms[9], terms[10], terms[11]
    rr = x * x + y * y
    above = 1.0 + rr * (k1 + rr * (k2 + rr * k3))
    below = 1.0 / (1.0 + rr * (k4 + rr * (k5 + rr * k6)))
    radial = above * below
    by_rr = below * (
        k1 + rr * (2.0 * k2 + 3.0 * rr * k3) - radial * (k4 + rr * (2.0 * k5 + 3.0 * rr * k6))
    )
    u = x * radial + 2.0 * p1 * x * y + p2 * (rr + 2.0 * x * x) + rr * (s1 + rr * s2)
    v = y * radial + p1 * (rr + 2.0 * y * y) + 2.0 * p2 * x * y + rr * (s3 + rr * s4)
    prism_u, prism_v = 2.0 * (s1 + 2.0 * rr * s2), 2.0 * (s3 + 2.0 * rr * s4)
    across = 2.0 * (x * y * by_rr + p1 * x + p2 * y)
    ux = radial + 2.0 * x * x * by_rr + 2.0 * p1 * y + 6.0 * p2 * x + x * prism_u
    uy = across + y * prism_u
    vx = across + x * prism_v
    vy = radial + 2.0 * y * y * by_rr + 6.0 * p1 * y + 2.0 * p2 * x + y * prism_v
    if terms[12] == 0.0:
        return u, v, ux, uy, vx, vy
    scale = 1.0 / (terms[19] * u + terms[20] * v + terms[21])
    tu = (terms[13] * u + terms[14] * v + terms[15]) * scale
    tv = (terms[16] * u + terms[17] * v + terms[18]) * scale
    a, b = (terms[13] - tu * terms[19]) * scale, (terms[14] - tu * terms[20]) * scale
    c, d = (terms[16] - tv * terms[19]) * scale, (terms[17] - tv * terms[20]) * scale
    return tu, tv, a * ux + b * vx, a * uy + b * vy, c * ux + d * vx, c * uy + d * vy


@compiled
def distortion_derivatives(
    x: float, y: float, lenses: FloatArray, camera: int, by_lens: FloatArray
) -> None:
    """Write the derivatives of the distorted point by k1, k2, p1, p2 to `by_lens` (2, 4);
    of a fisheye by k1, k2, k3, k4. Names as in `distort`."""
    terms = lenses[camera, 1:]
    if terms[12] == FISHEYE:
        fisheye_derivatives(x, y, by_lens)
        return
    rr = x * x + y * y
    below = 1.0 / (1.0 + rr * (terms[5] + rr * (terms[6] + rr * terms[7])))
    by_lens[0, 0], by_lens[1, 0] = x * rr * below, y * rr * below
    by_lens[0, 1], by_lens[1, 1] = rr * by_lens[0, 0], rr * by_lens[1, 0]
    by_lens[0, 2], by_lens[1, 2] = 2.0 * x * y, rr + 2.0 * y * y
    by_lens[0, 3], by_lens[1, 3] = rr + 2.0 * x * x, 2.0 * x * y
    if terms[12] == 0.0:
        return
    radial = (1.0 + rr * (terms[0] + rr * (terms[1] + rr * terms[4]))) * below
    u = x * radial + 2.0 * terms[2] * x * y + terms[3] * (rr + 2.0 * x * x)
    v = y * radial + terms[2] * (rr + 2.0 * y * y) + 2.0 * terms[3] * x * y
    u += rr * (terms[8] + rr * terms[9])
    v += rr * (terms[10] + rr * terms[11])
    scale = 1.0 / (terms[19] * u + terms[20] * v + terms[21])
    tu = (terms[13] * u + terms[14] * v + terms[15]) * scale
    tv = (terms[16] * u + terms[17] * v + terms[18]) * scale
    a, b = (terms[13] - tu * terms[19]) * scale, (terms[14] - tu * terms[20]) * scale
    c, d = (terms[16] - tv * terms[19]) * scale, (terms[17] - tv * terms[20]) * scale
    for i in range(4):
        along_x, along_y = by_lens[0, i], by_lens[1, i]
        by_lens[0, i], by_lens[1, i] = a * along_x + b * along_y, c * along_x + d * along_y


@compiled
def set_distortion(q: FloatArray, first: int, stride: int, lenses: FloatArray) -> FloatArray:
    """A copy of `lenses` (c, 23) with the k1, k2, p1, p2 that begin at q[first + stride * c]."""
    changed = np.empty(lenses.shape)
    for camera in range(len(lenses)):
        for i in range(TERMS + 1):
            changed[camera, i] = lenses[camera, i]
        for i in range(4):
            changed[camera, 1 + i] = q[first + stride * camera + i]
    return changed


def pixel_scales_of(focal_lengths: FloatArray, lenses: FloatArray) -> FloatArray:
    """The `camera.pixel_scales` of fx and fy (c, 2) and lenses (c, 23) with their distortion."""
    fisheye = lenses[:, 1 + TILTED] == FISHEYE
    scales = np.column_stack([focal_lengths[:, 0], lenses[:, 0], focal_lengths[:, 1]])
    if not fisheye.any():
        return scales
    with_fisheye = np.zeros((len(lenses), 2, 4))
    with_fisheye[:, 0, :3], with_fisheye[:, 0, 3] = scales, np.where(fisheye, lenses[:, 5], 0.0)
    with_fisheye[:, 1] = lenses[:, 1:5]
    return with_fisheye
