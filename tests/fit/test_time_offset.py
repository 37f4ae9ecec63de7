"""The time offset between the cameras, on simulated bars that move."""

from dataclasses import replace

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.screening.screen import screen
from stereocal.fit.start.free_baseline import with_rough_baseline
from stereocal.fit.timing.out_of_step import with_offset_if_out_of_step
from stereocal.formats.dataset_files import read_recording
from stereocal.library.calibrations import calibrate
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.tracks import TimeOffset
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.further import further
from tests.rigs import known_rig as rig
from tests.rigs.moving_bar import move_bar, record

FRAMES = 120
TIMED = CalibrationSettings(time_offset=True)
TIMED_REFINED = RefineSettings(time_offset=True)


def moving(late: float, drift: float = 0.0, between: int = 30) -> Pair:
    """A recording of the tests' rig."""
    rng = np.random.default_rng(1)
    bar = move_bar(
        Rig(rig.PRIMARY, rig.SECONDARY, rig.RIG), rng, FRAMES, rig.BAR_M, (4.0, 10.0), between
    )
    return record(bar, rng, 0.2, "moving", TimeOffset(late, drift, FRAMES / 2))


@pytest.mark.parametrize("late", [0.02, -2.0, *further(0.3, 1.4)])
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


@pytest.mark.parametrize("late", [0.1, *further(-1.0)])
def test_an_offset_that_nobody_asked_for_is_applied_and_all_files_carry_it(late: float) -> None:
    found = PairRun(moving(late))
    note = found.calibration.screening.time_note
    assert "out of step" in note
    assert ("counted 1 apart" in note) == (late == -1.0)
    for own in PairAnswer(found).sets.values():
        whole = round(late)  # a matter of counting, which other recordings need not share
        assert own.start_frame == whole
        entry = own.to_json()["time_offset_frames"]
        assert entry["value"] == pytest.approx(late - whole, abs=0.02)
        assert 0 < entry["standard_error"] < 0.01
        again = type(own).loads(own.dumps()).time_offset
        assert again is not None
        assert again.to_json() == {"time_offset_frames": entry}


def test_cameras_in_step_get_no_offset_unasked() -> None:
    found = PairRun(moving(0.0))
    assert found.screening.time_note == ""
    assert all(own.time_offset is None for own in PairAnswer(found).sets.values())


def test_where_all_frames_are_trusted_an_offset_is_only_offered() -> None:
    found = calibrate(moving(0.1), CalibrationSettings(all_frames=True))
    assert found.out_of_step and found.screening.shift is None
    assert any("+0.10" in text for text in found.warnings)


def test_without_moving_neighbours_it_stays_out() -> None:
    data = rig.dataset(25)
    alone = replace(data.correspondences, time_frame=3 * data.correspondences.frame)
    found = screen(data.changed(correspondences=alone), time_offset=True)
    assert "neighbours" in found.time_note
    assert found.measured_offset is None
    assert found.full_dataset.time_offset is None


def test_bars_placed_anew_for_each_photograph_are_in_step() -> None:
    run = PairRun(rig.dataset(25, 0.2), TIMED, TIMED_REFINED)
    assert "in step" in run.screening.time_note
    assert len(run.calibration.frames) == 25
    sets = PairAnswer(run).sets
    assert sets["2d"].time_offset is None
    assert sets["refined"].time_offset is not None


def test_exchanged_targets_are_recognised_between_frames() -> None:
    data = moving(0.3)
    found = screen(data.with_targets_exchanged([40, 80]), time_offset=True)
    assert found.exchanged == (40, 80)
    assert set(found.contradicting) <= {38, 39, 40, 41, 42, 78, 79, 80, 81, 82}
    assert found.measured_offset is not None
    assert found.measured_offset.frames == pytest.approx(0.3, abs=0.02)


def test_a_drift_is_found_asked_for_or_not() -> None:
    data = moving(0.3, drift=2e-3)
    asked = screen(data, time_offset=True, time_drift=True), screen(data, time_offset=True)
    in_step_half_way = screen(moving(0.0, drift=4e-3))
    for found in (*asked, screen(data), in_step_half_way):
        drift = 4e-3 if found is in_step_half_way else 2e-3
        assert "drifting by" in found.time_note
        own = found.measured_offset
        assert own is not None
        assert abs(own.drift - drift) < 4 * own.drift_sigma < 1e-3


def test_an_offset_without_which_no_pose_fits_is_found() -> None:
    found = screen(moving(1.9, between=5)).shift
    assert found is not None
    assert abs(found.frames - 1.9) < 4 * found.sigma < 0.1


def test_fewer_frames_than_are_held_out_show_no_offset() -> None:
    """Four frames of a real recording that fit with an offset ended in an IndexError."""
    seen = read_recording("sample_data/rig").of_cameras(("1", "2"))
    few = seen.where((seen.frame >= 450) & (seen.frame < 510)).counted_from({"2": 1})
    _, note = with_offset_if_out_of_step(with_rough_baseline(few.pair("1", "2")), RefineSettings())
    assert not note
