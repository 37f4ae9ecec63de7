"""Set up the 2D and the 3D minimisation problem of a data set."""

from __future__ import annotations

import numpy as np

from stereocal.calibration import costs
from stereocal.calibration.montecarlo import Problem
from stereocal.errors import StereocalError
from stereocal.rig.compiled import BoolArray
from stereocal.rig.dataset import Dataset


def reprojection_problem(dataset: Dataset, rows: BoolArray | None = None) -> Problem:
    """The 2D cost over the pairs of a data set: all of them, or those in the mask `rows` (n,)."""
    rays = dataset.rays if rows is None else np.ascontiguousarray(dataset.rays[:, rows])
    return Problem(costs.REPROJECTION, rays, np.empty((0, 0)), dataset.pixel_scale)


def reconstruction_problem(
    dataset: Dataset, known_points: bool = False, rows: BoolArray | None = None
) -> Problem:
    """The 3D cost over the bars of a data set, or over its known points.

    Args:
        rows: mask (n,) of the rows to use; all if None.
    """
    table = dataset.correspondences
    used = np.ones(len(table), dtype=np.bool_) if rows is None else rows
    if known_points:
        known = used & np.isfinite(dataset.known_points_m).all(axis=1)
        if not known.any():
            raise StereocalError(
                "No row has a known point: the columns x_m, y_m, z_m are missing or empty, and the "
                "targets are not those of a board."
            )
        return Problem(
            costs.POINTS,
            np.ascontiguousarray(dataset.rays[:, known]),
            np.ascontiguousarray(dataset.known_points_m[known].T),
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
        np.ascontiguousarray(dataset.bar_distances_m[None, bars]),
        dataset.pixel_scale,
    )
