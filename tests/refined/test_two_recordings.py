"""Recordings of boards that are two: a camera moved, or another board; and stretched boards."""

from dataclasses import replace

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import read_dataset
from stereocal.library.calibrations import calibrate
from stereocal.refined.disagreement import compare_inputs
from stereocal.refined.free_baseline import with_baseline_found
from stereocal.refined.refine import refine
from stereocal.refined.screening import screened
from stereocal.refined.stated_inputs import far_off
from stereocal.refined.stretched_board import stretched_board
from stereocal.refined.two_recordings import other_size
from stereocal.rig.rigid_object import BoardPattern
from tests import known_rig as rig
from tests.rigs.board_mistakes import board_of
from tests.rigs.board_pairs import BoardPair, draw_placings, drawn_rig, seen_by, sound, waved
from tests.rigs.pair_mistakes import moved, turned_after

PAIR = sound(0, frames=16, baseline=True)


@pytest.mark.parametrize(
    ("pair", "seed"),
    [(PAIR, [3]), pytest.param(sound(1, frames=16), [1, 5], id="or another board")],
)
def test_moved_camera_is_told_with_its_frame(pair: BoardPair, seed: list[int]) -> None:
    spoiled = moved(pair.dataset, np.random.default_rng(seed), 1.0)
    with pytest.raises(StereocalError, match=r"A camera moved between frames [789] "):
        screened(spoiled, CalibrationSettings())


def test_few_bars_after_a_movement_are_not_left_out_unsaid() -> None:
    """Nearly all of those bars were left out as contradicting the others, without a cause."""
    data = rig.dataset(120, 0.2)
    last = int(data.correspondences.frames[-21])
    turned = turned_after(data, "secondary", np.radians([0.0, 0.5, 0.0]), last)
    with pytest.raises(StereocalError, match=f"A camera moved between frames {last} and "):
        screened(turned, CalibrationSettings())


def test_few_frames_of_much_noise_are_no_movement() -> None:
    """Thirteen frames in which the wand moved fast; the third camera saw that none moved."""
    data = read_dataset("sample_data/rig", pair="1-2")
    screened(data.of_frames(range(289, 619)), CalibrationSettings())


def test_another_board_is_told() -> None:
    spoiled = board_of(PAIR, np.array([1.15, 1.15]), second_half=True)
    with pytest.raises(StereocalError, match=r"the board is 1\.1\d times as large"):
        screened(spoiled.dataset, CalibrationSettings())


def test_sound_recording_is_one() -> None:
    found = screened(PAIR.dataset, CalibrationSettings())
    assert not found.together


def test_stretched_board_is_told_and_sound_one_is_not() -> None:
    assert not stretched_board(refine(PAIR.dataset))
    some = board_of(PAIR, np.array([1.007, 1.0]))
    said = stretched_board(refine(some.dataset))
    assert "rows" in said and "ruler" in said
    with pytest.raises(StereocalError, match="columns of the board are"):
        stretched_board(refine(board_of(PAIR, np.array([1.0, 1.015])).dataset))


def test_a_length_that_is_far_off_is_a_reason_not_to_rely_on_the_files() -> None:
    def caution(factor: float) -> str:
        board = replace(PAIR.board, square_m=factor * PAIR.board.square_m)
        return far_off(compare_inputs(refine(replace(PAIR, board=board).dataset)).inputs)

    assert "contradict" in caution(1.1)
    assert not caution(1.01)


def test_bars_that_are_longer_and_shorter_are_no_other_bar() -> None:
    fit = refine(rig.dataset(60, 0.2))
    logs = np.repeat([0.06, -0.06, 0.0], [3, 3, 54])
    lengths = fit.dataset.bar_distances_m * np.exp(logs)
    rows = fit.dataset.correspondences
    stated = replace(rows, distance_m=np.repeat(lengths, 2))
    assert not other_size(replace(fit, dataset=replace(fit.dataset, correspondences=stated)))


def test_camera_that_sees_all_corners_at_one_place_ends_in_no_traceback() -> None:
    points = PAIR.points.copy()
    points[:, :, 1] = points[:, :1, 1]
    with pytest.raises(StereocalError):
        calibrate(replace(PAIR, points=points).dataset)


def test_baseline_of_boards_out_of_step_is_found_in_step() -> None:
    late = waved(0, 0.3, frames=24)
    assert late.truth is not None
    found = with_baseline_found(late.dataset).baseline_m
    # Measured: 0.4 % off; 1.8 % as recorded.
    assert found == pytest.approx(late.truth.pose.baseline, rel=0.008)


def test_level_boards_do_not_tell_a_stretch_from_focal_lengths() -> None:
    rng = np.random.default_rng(1)
    own, far = drawn_rig(rng)
    board = BoardPattern(9, 6, 0.03 * far)
    placings = draw_placings(own, far, board, rng, 12, largest_roll=0.1)
    pair = seen_by(own, board, placings, rng, 0.2, baseline=True)
    stretched = np.diag([1.02, 1.0, 1.0])
    wrong = [replace(camera, K=camera.K @ stretched) for camera in pair.cameras]
    said = stretched_board(refine(replace(pair, cameras=(wrong[0], wrong[1])).dataset))
    assert "fx and fy" in said
