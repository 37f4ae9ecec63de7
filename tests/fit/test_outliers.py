"""Frames that stand out."""

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.fit.results import Calibration
from stereocal.fit.screening.outliers import (
    length_outliers,
    outlying,
    outlying_frames,
    reprojection_outliers,
)
from stereocal.library.calibrations import calibrate
from tests.rigs import known_rig as rig
from tests.rigs.mistakes import misplaced

MIXED_UP = 11


def make_calibration(noise_px: float, shift_px: float) -> Calibration:
    """25 frames numbered from 1; frame 1 has no B, the B of `MIXED_UP` is off by `shift_px`."""
    exact = rig.dataset(25, noise_px)
    rows = exact.correspondences
    off = misplaced(exact, (rows.frame == MIXED_UP) & (rows.target == 1), [0.0, shift_px])
    shifted = off.correspondences.where((rows.frame > 1) | (rows.target == 0))
    dataset = exact.changed(correspondences=shifted)
    return calibrate(dataset, CalibrationSettings(calibration_frames=20), trace=True)


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return make_calibration(noise_px=0.2, shift_px=10.0)


def test_the_mixed_up_frame_stands_out_alone(calibration: Calibration) -> None:
    assert reprojection_outliers(calibration) == [MIXED_UP]
    assert outlying_frames(calibration) == sorted({MIXED_UP, *length_outliers(calibration)})


def test_held_out_frames_are_those_neither_calibrated_with_nor_left_out(
    calibration: Calibration,
) -> None:
    frames = calibration.dataset.correspondences.frames
    assert calibration.screening.left_out == (MIXED_UP,)
    assert len(calibration.held_out_frames) == 25 - 1 - 20
    rest = np.setdiff1d(frames, [*calibration.held_out_frames, MIXED_UP])
    assert set(rest) == set(calibration.frames)


def test_the_limit_is_six_robust_deviations_above_the_median() -> None:
    values = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 0.0, 0.0])
    limit = 2.0 + 6 * 1.4826 * 2.0  # median 2; deviations 1 0 1 2 3 2 2 have the median 2
    assert not outlying(values, 0.0).any()
    above = values.copy()
    above[4] = limit + 1e-3
    assert outlying(above, 0.0).tolist() == [False] * 4 + [True] + [False] * 2
    above[4] = limit - 1e-3
    assert not outlying(above, 0.0).any()
