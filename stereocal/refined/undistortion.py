"""Undistortion of all pixels with the lenses of the shared unknowns, compiled."""

from __future__ import annotations

import numpy as np

from stereocal.refined.distortion import distort
from stereocal.refined.two_views import PRIMARY, SECONDARY
from stereocal.rig.compiled import FloatArray, compiled

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
