"""Where a fit of two cameras behind windows begins: poses of bent rays, and planes.

Seen from far, a camera behind a window is nearly one with a longer focal length, so that rays bent
at a window square to it give a pose as in air. The normals that are tried are those of a wall that
both cameras look at alike, and turned from there.
"""

from collections.abc import Iterator, Mapping

import numpy as np

from stereocal.errors import StereocalError
from stereocal.fit.least_squares.stated_windows import BEGIN_M, SQUARE, is_shared, window_name
from stereocal.fit.start.first_poses import first_poses
from stereocal.rig.geometry import Pose, triangulate_rays
from stereocal.rig.pair import Pair
from stereocal.rig.window import StatedWindow
from stereocal.system.array_types import FloatArray

NEAREST, PARTS_OF_NEAREST, LEAST_M = 0.05, (0.4, 0.1, 0.7), 1e-3
"""Distances that are tried, as parts of that to the nearest points: nearly all begin well. (Of 480
starts of eight rigs, with walls at 3 cm to 1 m and angles of 0 to 45 degrees, 430 ended at the same
minimum; of those turned by (0, 0), all.)"""
TURNS = ((0.0, 0.0), (0.4, 0.0), (-0.4, 0.0), (0.0, 0.4), (0.0, -0.4))
"""Of the normal, added to its a and b."""
MOST_TANGENT = 2.0
Begin = tuple[Pose, Mapping[str, float]]
"""`second_from_first`, and free parameters by name."""


def begins_behind_windows(dataset: Pair, rays: FloatArray, robust: bool) -> Iterator[Begin]:
    """Poses and windows to begin with, the most usual first.

    Args:
        rays: (4, n), in air, of the points to fit.
        robust: as of `first_poses`.
    """
    windows, names = dataset.recording.windows, list(dataset.recording.cameras)
    mediums = {name: window.medium for window in windows for name in window.cameras}
    bent = rays.copy()
    for number, name in enumerate(names):
        camera = slice(2 * number, 2 * number + 2)
        bent[camera] = _in_medium(rays[camera].T, mediums.get(name, 1.0)).T
    shared = next((window for window in windows if is_shared(window, names)), None)
    poses = _poses(dataset, bent, robust)
    for turn in TURNS:
        for pose in poses:
            if shared is None:
                yield pose, {}
                continue
            points = triangulate_rays(pose.R, pose.T, bent)
            if np.isnan(points[:, 2]).all():
                continue
            for normal in _normals(shared, pose, turn):
                nearest = float(np.nanquantile(points @ normal, NEAREST))
                for part in PARTS_OF_NEAREST:
                    distance_m = shared.distance_m or max(part * nearest, LEAST_M)
                    yield pose, _values(dataset, shared, normal, distance_m)
        if shared is None or shared.normal is not None:
            return


def _values(
    dataset: Pair, window: StatedWindow, normal: FloatArray, distance_m: float
) -> dict[str, float]:
    """The free parameters of a window that begins there, from where its unknowns begin."""
    label, stated = dataset.recording.labels[0], np.array(window.normal or SQUARE)
    a, b = normal[:2] / normal[2] - stated[:2] / stated[2]
    parts = {"x": a, "y": b, "distance": distance_m - (window.distance_m or BEGIN_M)}
    return {window_name(label, part): float(value) for part, value in parts.items()}


def _normals(window: StatedWindow, pose: Pose, turn: tuple[float, float]) -> Iterator[FloatArray]:
    """Normals in the first camera's frame: that from which both cameras are as far, and the middle
    of their axes, turned; or the stated one."""
    if window.normal is not None:
        yield np.array(window.normal) / np.linalg.norm(window.normal)
        return
    of_axes = np.array(SQUARE) + pose.R.T @ np.array(SQUARE)
    along = pose.R.T @ pose.T / pose.baseline
    for normal in (of_axes - (of_axes @ along) * along, of_axes):
        if normal[2] > 0.0:
            tangents = np.clip(normal[:2] / normal[2], -MOST_TANGENT, MOST_TANGENT) + turn
            if (pose.R @ np.append(tangents, 1.0))[2] > 0.0:
                yield np.append(tangents, 1.0) / np.sqrt(1.0 + tangents @ tangents)


def _in_medium(rays: FloatArray, medium: float) -> FloatArray:
    """(n, 2): points of z = 1 of rays (n, 2) after a surface square to the axis."""
    square = np.square(rays).sum(axis=1, keepdims=True)
    return np.asarray(rays / np.sqrt(medium**2 * (1.0 + square) - square))


def _poses(dataset: Pair, rays: FloatArray, robust: bool) -> list[Pose]:
    """Poses of bent rays, the best first."""
    try:
        apart, alike = first_poses(dataset, None, np.ascontiguousarray(rays), robust)
    except StereocalError:
        return []
    return apart + alike
