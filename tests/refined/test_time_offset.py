"""The time offset between the cameras, on simulated bars that move."""

from __future__ import annotations

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.refined.screening import screen
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.dataset import Dataset
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import TimeOffset
from stereocal.simulation.moving_bar import move_bar, record
from stereocal.workflow import answer, calibrate
from tests import known_rig as rig

FRAMES = 120
TIMED = CalibrationSettings(time_offset=True)
TIMED_REFINED = RefineSettings(time_offset=True)


def moving(late: float, drift: float = 0.0, seed: int = 1, between: int = 30) -> Dataset:
    """A recording of the tests' rig with 0.2 px of noise."""
    rng = np.random.default_rng(seed)
    bar = move_bar(
        Rig(rig.PRIMARY, rig.SECONDARY, rig.RIG), rng, FRAMES, rig.BAR_M, (4.0, 10.0), between
    )
    return record(bar, rng, 0.2, "moving", TimeOffset(late, drift, FRAMES / 2))


@pytest.mark.parametrize("late", [0.02, 0.3, 1.4, -2.0])
def test_the_offset_is_found(late: float) -> None:
    found = screen(moving(late), time_offset=True)
    measured = found.measured_offset
    assert measured is not None
    assert abs(measured.frames - late) < 4 * measured.sigma < 0.04
    assert found.fit is not None
    assert found.fit.sigma_px.value == pytest.approx(0.2, rel=0.15)
    assert len(found.contradicting) <= 2


def test_cameras_in_step_are_left_alone() -> None:
    data = moving(0.0)
    found = screen(data, time_offset=True)
    assert "in step" in found.time_note
    assert found.shift is None
    np.testing.assert_array_equal(
        found.full_dataset.correspondences.secondary, data.correspondences.secondary
    )


def test_all_files_carry_it() -> None:
    found = calibrate(moving(0.7), TIMED, refined=TIMED_REFINED)
    for own in answer(found, None).sets.values():
        entry = own.to_json()["time_offset_frames"]
        assert entry["value"] == pytest.approx(0.7, abs=0.02)
        assert 0 < entry["standard_error"] < 0.01
        again = type(own).loads(own.dumps()).time_offset
        assert again is not None
        assert again.to_json() == {"time_offset_frames": entry}


def test_it_is_offered_by_itself() -> None:
    late = calibrate(moving(0.1))
    assert any("out of step" in text and "+0.10" in text for text in late.warnings)
    assert not any("step" in text for text in calibrate(moving(0.0)).warnings)
