"""The problems of the 2D and the 3D cost, on objects."""

from __future__ import annotations

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.calibration.montecarlo import reconstruction_problem
from stereocal.errors import StereocalError
from stereocal.workflow import calibrate
from tests import known_rig
from tests.rigs.objects import BOARD, WAND, recorded


def test_a_board_is_placed_by_the_primary_camera_alone() -> None:
    """Measured without noise: 9e-13 px, and a cost of 2e-14 m a corner at the true pose."""
    data = recorded(BOARD, noise_px=0.0)
    found = data.known_points_m
    assert np.isfinite(found).all()
    u, _ = known_rig.images(found)
    assert np.abs(u - data.correspondences.primary).max() < 1e-8
    problem = reconstruction_problem(data, known_points=True)
    assert problem.cost(known_rig.RIG) / len(found) < 1e-9


def test_corners_of_a_board_that_is_hardly_seen_are_unknown() -> None:
    seen = np.ones((24, len(BOARD.names)), dtype=np.bool_)
    seen[3, 3:] = False
    data = recorded(BOARD, seen=seen)
    unknown = np.isnan(data.known_points_m).all(axis=1)
    assert (unknown == (data.correspondences.frame == 4)).all()


def test_known_points_of_a_board_keep_the_3d_set_near_the_images() -> None:
    """Footnote 4 of the paper: measured 0.21 px, not 3.0 px; lengths 0.50 %, not 0.60 %."""
    data = recorded(BOARD, noise_px=0.3)
    lengths, points = (
        calibrate(data, CalibrationSettings(known_points=known), refined=None).errors["3d"]
        for known in (False, True)
    )
    assert np.mean(points.reprojection_px) < 0.2 * np.mean(lengths.reprojection_px)
    assert np.median(points.length) < 1.2 * np.median(lengths.length)


def test_a_bar_or_a_wand_has_no_known_points() -> None:
    for data in (recorded(WAND), known_rig.dataset()):
        with pytest.raises(StereocalError, match="No row has a known point"):
            reconstruction_problem(data, known_points=True)
