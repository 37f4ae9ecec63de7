"""Simulated images of a rig whose truth is known, and the errors of parameter sets on them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from stereocal.evaluation.counting import BINS, count_pairs, count_pairs_behind_windows
from stereocal.fit.least_squares.distortion import distort, pixel_scales_of
from stereocal.fit.least_squares.small_steps import undistort_rays
from stereocal.fit.least_squares.views import EACH, LENS, TRANSLATION, Cameras, with_lenses
from stereocal.fit.least_squares.windows import seen_in_air
from stereocal.rig.compiled import compiled
from stereocal.rig.geometry import fill_essential, triangulate_rays
from stereocal.rig.rig import Rig
from stereocal.system.array_types import CountArray, FloatArray, IntArray


@compiled
def photograph(cameras: Cameras, points: FloatArray, pixels: FloatArray) -> None:
    """Write the pixels (n, 2 c), u and v in each camera, of points (n, 3)."""
    q, R, lenses, windows = with_lenses(cameras)
    work = np.empty((2, 14))
    for k in range(len(points)):
        for c in range(len(R)):
            start, turned = EACH * c, R[c] @ points[k]
            depth = turned[2] + q[start + TRANSLATION + 2]
            a, b = turned[0] + q[start + TRANSLATION], turned[1] + q[start + TRANSLATION + 1]
            a, b, depth = seen_in_air(windows, q, R, c, start, a, b, depth, work)
            x, y, _, _, _, _ = distort(a / depth, b / depth, lenses, c)
            pixels[k, 2 * c] = q[start + LENS] * x + lenses[c, 0] * y + q[start + LENS + 2]
            pixels[k, 2 * c + 1] = q[start + LENS + 1] * y + q[start + LENS + 3]


def add_noise(
    rig: Rig, points: FloatArray, along: float, noise: FloatArray, pixels: FloatArray
) -> FloatArray:
    """Add noise (n, 4) to the pixels (n, 4) of points (n, 3), and return their rays (4, n), which
    behind windows are not used.

    The noise across the epipolar lines of the rig is added as it is; the rest, which moves the
    reconstructed point, `along` times.
    """
    if rig.has_windows:
        slopes = rig.residual_slopes(*np.hsplit(pixels, 2))
        _add_across(slopes, along, noise, pixels)
        return np.empty((4, len(pixels)))
    E, both = rig.pose.essential, [xyz / xyz[:, 2:] for xyz in (points, rig.pose.apply(points))]
    lines, across = (both[1] @ E, both[0] @ E.T), []
    for camera, rays, line in zip((rig.primary, rig.secondary), both, lines, strict=True):
        by_pixel = line[:, :2] / np.diag(camera.K)[:2]
        if camera.is_fisheye:
            J = camera.pixel_jacobians(rays[:, :2]).transpose(0, 2, 1)
            by_pixel = np.asarray(np.linalg.solve(J, line[:, :2, None])[..., 0], np.float64)
        across.append(by_pixel)
    _add_across(np.hstack(across), along, noise, pixels)
    return np.ascontiguousarray(np.hstack([rays[:, :2] for rays in both]).T)


def _add_across(unit: FloatArray, along: float, noise: FloatArray, pixels: FloatArray) -> None:
    """Add noise to pixels, its part along vectors (n, 4) of any length as it is."""
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    part = unit * np.sum(unit * noise, axis=1, keepdims=True)
    pixels += part + along * (noise - part)


class JudgedSets(NamedTuple):
    """What `judge` counted and measured with s sets."""

    counts: CountArray
    """(s, 2, 2, BINS + 2): as in `evaluate.RunCounts`."""
    lengths: FloatArray
    """(s, m): D^R / D of the bars."""
    correct_px: FloatArray
    """(s,): mean reprojection error of the correct pairs."""


def judge(
    sets: Sequence[Cameras],
    pixels: FloatArray,
    start: FloatArray,
    distances: FloatArray,
    partners: IntArray,
) -> JudgedSets:
    """Count the errors of all pairs with each set, and measure the bars.

    Args:
        sets: s, of two cameras.
        pixels: (n, 4): the ends A and B of each bar in turn, n = 2 m.
        start: (4, n): initial rays for the undistortion.
        distances: (m,), the true lengths in metres.
        partners: (n, p): the secondary points paired with each primary point.
    """
    s, bars = len(sets), len(distances)
    counts = np.zeros((s, 2, 2, BINS + 2), dtype=np.int32)
    judged = JudgedSets(counts, np.full((s, bars), np.nan), np.full(s, np.nan))
    nans, rays = np.zeros(2, dtype=np.int64), start.copy()
    E = np.empty((3, 3))
    for k, cameras in enumerate(sets):
        q, (_, R), lenses, _ = with_lenses(cameras)
        if not undistort_rays(q, lenses, pixels, rays):
            rays = start.copy()
            continue
        T = q[EACH + TRANSLATION : EACH + LENS]
        fill_essential(R, T, E)
        scale = pixel_scales_of(q[[[LENS, LENS + 1], [EACH + LENS, EACH + LENS + 1]]], lenses)
        judged.correct_px[k] = count_pairs(R, T, E, rays, scale, partners, counts[k], nans)
        ends = triangulate_rays(R, T, rays).reshape(bars, 2, 3)
        judged.lengths[k] = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / distances
    return judged


def judge_behind_windows(
    rigs: Sequence[Rig], pixels: FloatArray, distances: FloatArray, partners: IntArray
) -> JudgedSets:
    """`judge` with s rigs whose cameras look through windows."""
    s, bars = len(rigs), len(distances)
    counts = np.zeros((s, 2, 2, BINS + 2), dtype=np.int32)
    judged = JudgedSets(counts, np.full((s, bars), np.nan), np.full(s, np.nan))
    nans = np.zeros(2, dtype=np.int64)
    for k, rig in enumerate(rigs):
        judged.correct_px[k] = count_pairs_behind_windows(rig, pixels, partners, counts[k], nans)
        ends = rig.reconstruct(*np.hsplit(pixels, 2)).reshape(bars, 2, 3)
        judged.lengths[k] = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1) / distances
    return judged
