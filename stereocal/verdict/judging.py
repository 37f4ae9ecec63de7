"""Simulated images of a rig whose truth is known, and the errors of parameter sets on them."""

from typing import NamedTuple

import numpy as np

from stereocal.evaluation.counting import BINS, count_pairs
from stereocal.refined.distortion import distort, pixel_scales_of, set_distortion
from stereocal.refined.two_views import BASELINE, DISTORTION, PRIMARY, SECONDARY, undistort_rays
from stereocal.rig.compiled import compiled
from stereocal.rig.geometry import fill_essential, fill_pose, triangulate_rays
from stereocal.rig.rig import Rig
from stereocal.system.array_types import CountArray, FloatArray, IntArray


@compiled
def photograph(
    q: FloatArray, stated_lenses: FloatArray, points: FloatArray, pixels: FloatArray
) -> None:
    """Write the pixels (n, 4), u and v of the primary and the secondary, of points (n, 3)."""
    lenses = set_distortion(q, DISTORTION, 4, stated_lenses)
    R, T = np.empty((3, 3)), np.empty(3)
    fill_pose(q, q[BASELINE], R, T)
    for k in range(len(points)):
        a, b, c = points[k, 0], points[k, 1], points[k, 2]
        for camera in range(2):
            at = PRIMARY if camera == 0 else SECONDARY
            if camera == 1:
                a, b, c = (
                    R[0, 0] * a + R[0, 1] * b + R[0, 2] * c + T[0],
                    R[1, 0] * a + R[1, 1] * b + R[1, 2] * c + T[1],
                    R[2, 0] * a + R[2, 1] * b + R[2, 2] * c + T[2],
                )
            x, y, _, _, _, _ = distort(a / c, b / c, lenses, camera)
            pixels[k, 2 * camera] = q[at] * x + lenses[camera, 0] * y + q[at + 2]
            pixels[k, 2 * camera + 1] = q[at + 1] * y + q[at + 3]


def add_noise(
    rig: Rig, points: FloatArray, along: float, noise: FloatArray, pixels: FloatArray
) -> FloatArray:
    """Add noise (n, 4) to the pixels (n, 4) of points (n, 3), and return their rays (4, n).

    The noise across the epipolar lines of the rig is added as it is; the rest, which moves the
    reconstructed point, `along` times.
    """
    E, both = rig.pose.essential, [own / own[:, 2:] for own in (points, rig.pose.apply(points))]
    lines, across = (both[1] @ E, both[0] @ E.T), []
    for camera, rays, line in zip((rig.primary, rig.secondary), both, lines, strict=True):
        by_pixel = line[:, :2] / np.diag(camera.K)[:2]
        if camera.is_fisheye:
            J = camera.pixel_jacobians(rays[:, :2]).transpose(0, 2, 1)
            by_pixel = np.asarray(np.linalg.solve(J, line[:, :2, None])[..., 0], np.float64)
        across.append(by_pixel)
    unit = np.hstack(across)
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    part = unit * np.sum(unit * noise, axis=1, keepdims=True)
    pixels += part + along * (noise - part)
    return np.ascontiguousarray(np.hstack([own[:, :2] for own in both]).T)


class JudgedSets(NamedTuple):
    """What `judge` counted and measured with s sets."""

    counts: CountArray
    """(s, 2, 2, BINS + 2): as in `evaluate.RunCounts`."""
    lengths: FloatArray
    """(s, m): D^R / D of the bars."""
    correct_px: FloatArray
    """(s,): mean reprojection error of the correct pairs."""


def judge(
    sets: FloatArray,
    stated_lenses: FloatArray,
    pixels: FloatArray,
    start: FloatArray,
    distances: FloatArray,
    partners: IntArray,
) -> JudgedSets:
    """Count the errors of all pairs with each set, and measure the bars.

    Args:
        sets: (s, 25): the shared unknowns of `two_views` of each set.
        stated_lenses: (2, 23), as in `views.fill_residuals`.
        pixels: (n, 4): the ends A and B of each bar in turn, n = 2 m.
        start: (4, n): initial rays for the undistortion.
        distances: (m,), the true lengths in metres.
        partners: (n, p): the secondary points paired with each primary point.
    """
    s, bars, lenses = len(sets), len(distances), stated_lenses.copy()
    counts = np.zeros((s, 2, 2, BINS + 2), dtype=np.int32)
    found = JudgedSets(counts, np.full((s, bars), np.nan), np.full(s, np.nan))
    nans, rays = np.zeros(2, dtype=np.int64), start.copy()
    R, T, E = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    for at, q in enumerate(sets):
        lenses[:, 1:5] = q[DISTORTION : DISTORTION + 8].reshape(2, 4)
        if not undistort_rays(q, lenses, pixels, rays):
            rays = start.copy()
            continue
        fill_pose(q, q[BASELINE], R, T)
        fill_essential(R, T, E)
        scale = pixel_scales_of(q[[[PRIMARY, PRIMARY + 1], [SECONDARY, SECONDARY + 1]]], lenses)
        found.correct_px[at] = count_pairs(R, T, E, rays, scale, partners, counts[at], nans)
        ends = triangulate_rays(R, T, rays).reshape(bars, 2, 3)
        found.lengths[at] = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / distances
    return found
