"""The shared unknowns of a pair, and the two views that they describe.

`q` (25,): the five angles, the baseline in metres, the factor of the bar's length, fx, fy, cx, cy
of the primary and of the secondary camera, k1, k2, p1, p2 of the primary and of the secondary
camera, and the time by which the secondary camera is late, in frames, with its drift in frames per
frame.
"""

import numpy as np

from stereocal.refined import views
from stereocal.refined.distortion import distort
from stereocal.refined.views import EACH, LENS, TRANSLATION
from stereocal.rig.compiled import FloatArray, compiled
from stereocal.rig.geometry import fill_pose

YAW, PITCH, ROLL, DELTA, EPSILON, BASELINE, BAR, PRIMARY, SECONDARY = 0, 1, 2, 3, 4, 5, 6, 7, 11
DISTORTION = 15
"""The first of k1, k2, p1, p2 of the primary; those of the secondary follow."""
TIME, DRIFT = 23, 24
SHARED = 25
OF_VIEWS = 2 * EACH + 1


@compiled
def fill_views(q: FloatArray, v: FloatArray, R: FloatArray, B: FloatArray) -> None:
    """Write the unknowns of `views` (33,), the rotations (2, 3, 3), and B (25, 33), the derivatives
    of v by q.

    R is a product of rotations about y, x and z; the derivative by an angle is a rotation about its
    axis, rotated by the factors to its left.
    """
    for i in range(OF_VIEWS):
        v[i] = 0.0
        for j in range(SHARED):
            B[j, i] = 0.0
    for i in range(3):
        for j in range(3):
            R[0, i, j] = 1.0 if i == j else 0.0
    fill_pose(q, q[BASELINE], R[1], v[EACH + TRANSLATION : EACH + LENS])
    cy, sy = np.cos(q[YAW]), np.sin(q[YAW])
    cd, sd = np.cos(q[DELTA]), np.sin(q[DELTA])
    ce, se = np.cos(q[EPSILON]), np.sin(q[EPSILON])
    b, at = q[BASELINE], EACH + TRANSLATION
    B[YAW, EACH + 1], B[PITCH, EACH], B[PITCH, EACH + 2] = 1.0, cy, -sy
    for i in range(3):
        B[ROLL, EACH + i] = R[1, i, 2]
    B[DELTA, at], B[DELTA, at + 1], B[DELTA, at + 2] = -b * sd * ce, -b * sd * se, b * cd
    B[EPSILON, at], B[EPSILON, at + 1] = -b * cd * se, b * cd * ce
    B[BASELINE, at], B[BASELINE, at + 1], B[BASELINE, at + 2] = cd * ce, cd * se, sd
    for camera in range(2):
        for i in range(4):
            at = EACH * camera + LENS + i
            v[at], B[PRIMARY + 4 * camera + i, at] = q[PRIMARY + 4 * camera + i], 1.0
            at += 4
            v[at], B[DISTORTION + 4 * camera + i, at] = q[DISTORTION + 4 * camera + i], 1.0
    for i in range(2):
        v[EACH + views.TIME + i], B[TIME + i, EACH + views.TIME + i] = q[TIME + i], 1.0
    v[OF_VIEWS - 1], B[BAR, OF_VIEWS - 1] = q[BAR], 1.0


def views_of(q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """As `fill_views` writes them."""
    v, R, B = np.empty(OF_VIEWS), np.empty((2, 3, 3)), np.empty((SHARED, OF_VIEWS))
    fill_views(q, v, R, B)
    return v, R, B


MAXIMUM_ITERATIONS = 20


@compiled
def undistort_rays(
    q: FloatArray,
    lenses: FloatArray,
    pixels: FloatArray,
    rays: FloatArray,
    inverse_jacobians: FloatArray,
) -> bool:
    """Undistort pixels with the lenses of q, by Newton's method.

    Args:
        q: (25,), the shared unknowns of `two_views`; the distortion is that of `lenses`.
        lenses: (2, 23), as in `views.fill_residuals`.
        pixels: (n, 4): u, v of the primary and of the secondary.
        rays: (4, n), updated; the initial values are used as the start.
        inverse_jacobians: (n, 2, 4), written: of each camera's distortion, xx, xy, yx, yy.

    Returns:
        False if it does not converge.
    """
    for camera in range(2):
        at = PRIMARY if camera == 0 else SECONDARY
        fx, fy, cx, cy = q[at], q[at + 1], q[at + 2], q[at + 3]
        skew = lenses[camera, 0]
        for k in range(len(pixels)):
            by = (pixels[k, 2 * camera + 1] - cy) / fy
            bx = (pixels[k, 2 * camera] - cx - skew * by) / fx
            x, y = rays[2 * camera, k], rays[2 * camera + 1, k]
            error = np.inf
            for _ in range(MAXIMUM_ITERATIONS):
                u, v, xx, xy, yx, yy = distort(x, y, lenses, camera)
                scale = 1.0 / (xx * yy - xy * yx)
                du, dv = u - bx, v - by
                x -= scale * (yy * du - xy * dv)
                y -= scale * (xx * dv - yx * du)
                error = abs(du) + abs(dv)
                if error < 1e-12:
                    break
            if not error < 1e-9:
                return False
            rays[2 * camera, k], rays[2 * camera + 1, k] = x, y
            s = inverse_jacobians[k, camera]
            s[0], s[1], s[2], s[3] = scale * yy, -scale * xy, -scale * yx, scale * xx
    return True
