"""Set up the 2D and the 3D minimisation problem of a data set."""

from __future__ import annotations

import cv2
import numpy as np

from stereocal.calibration import costs
from stereocal.calibration.montecarlo import Problem
from stereocal.errors import StereocalError
from stereocal.rig.compiled import BoolArray, FloatArray
from stereocal.rig.dataset import Dataset

FEWEST_TO_PLACE = 4
"""Points of an object in one image."""
COLLINEAR = 0.05
"""Points closer to a line than this share of their length do not tell how they are turned."""


def reprojection_problem(dataset: Dataset, rows: BoolArray | None = None) -> Problem:
    """The 2D cost over the pairs of a data set: all of them, or those in the mask `rows` (n,)."""
    rays = dataset.rays if rows is None else np.ascontiguousarray(dataset.rays[:, rows])
    return Problem(costs.REPROJECTION, rays, np.empty((0, 0)), dataset.pixel_scale)


def reconstruction_problem(
    dataset: Dataset, known_points: bool = False, rows: BoolArray | None = None
) -> Problem:
    """The 3D cost over the bars of a data set, or over its known points (`known_points_of`).

    Args:
        rows: mask (n,) of the rows to use; all if None.
    """
    table = dataset.correspondences
    used = np.ones(len(table), dtype=np.bool_) if rows is None else rows
    if known_points:
        points = known_points_of(dataset)
        known = used & np.isfinite(points).all(axis=1)
        if not known.any():
            raise StereocalError(
                "No row has a known point: the columns x_m, y_m, z_m are missing or empty, and the "
                "targets are not those of a board."
            )
        return Problem(
            costs.POINTS,
            np.ascontiguousarray(dataset.rays[:, known]),
            np.ascontiguousarray(points[known].T),
            dataset.pixel_scale,
        )
    bars = dataset.bars_among(used)
    if not bars.any():
        raise StereocalError(
            "No frame has both targets A and B, so there is no length to measure: the 3D method "
            "needs frames in which both cameras see both ends of the bar."
        )
    return Problem(
        costs.DISTANCE,
        np.ascontiguousarray(dataset.rays[:, table.bars[bars].T.ravel()]),
        dataset.bar_distances_m[None, bars],
        dataset.pixel_scale,
    )


def known_points_of(dataset: Dataset) -> FloatArray:
    """Known points in the primary camera's frame, (n, 3), in metres; NaN where unknown.

    Those of the table. Of an object in a plane, such as a board, where the image of the primary
    camera alone places it (paper, footnote 4).
    """
    table, found = dataset.correspondences, dataset.correspondences.known_points_m
    if table.rigid_object is None or np.isfinite(found).any():
        return found
    placed = np.full_like(found, np.nan)
    for frame in table.frames:
        rows = np.flatnonzero(table.frame == frame)
        own = table.rigid_object.points[table.target[rows]]
        spread = np.linalg.svd(own - own.mean(axis=0), compute_uv=False)
        if len(rows) < FEWEST_TO_PLACE or spread[1] < COLLINEAR * spread[0]:
            continue
        rays = np.ascontiguousarray(dataset.rays[:2, rows].T)
        # SQPnP takes four points, in a plane or not; ITERATIVE wants six that are not.
        solved, turn, at = cv2.solvePnP(own, rays, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
        if solved:
            turn, at = cv2.solvePnPRefineLM(own, rays, np.eye(3), None, turn, at)
            placed[rows] = own @ cv2.Rodrigues(turn)[0].T + at.T
    return placed
