"""Cameras that moved while bars were recorded, and bars of two lengths, are told."""

import re
from pathlib import Path

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.errors import StereocalError
from stereocal.formats.dataset_files import read_dataset
from stereocal.refined.screening import screened
from stereocal.rig.dataset import Dataset
from tests.further import further
from tests.rigs.culprits import sound
from tests.rigs.pair_mistakes import MISTAKES, moved, turned_after
from tests.rigs.refined_rigs import (
    Misjudged,
    random_rig,
    smooth_fields,
    stated,
    waved_scene,
    with_waves,
)

SAMPLE = Path(__file__).parents[2] / "sample_data" / "recording"


def said_of(data: Dataset) -> str:
    try:
        screened(data, CalibrationSettings())
    except StereocalError as error:
        return str(error)
    return ""


@pytest.mark.parametrize(
    ("kind", "degrees", "frames"),
    [
        ("balls", 0.3, 60),
        *further(("like cameras", 2.0, 25), ("fisheyes", 1.0, 40), ("tags", 2.0, 30)),
    ],
)
def test_a_camera_that_moved_is_told_with_its_frame(kind: str, degrees: float, frames: int) -> None:
    """Measured: the frame itself; where few points tell, the one before or after."""
    _, data, rng = sound(kind, 1, frames)
    assert not said_of(data)
    found = re.search(r"moved between frames (\d+) and", said_of(moved(data, rng, degrees)))
    assert found and abs(int(found[1]) - frames / 2) < 2


def test_lenses_that_are_not_as_their_model_are_no_movement() -> None:
    rng = np.random.default_rng([2, 31, 10])
    cameras, fields = random_rig(rng), smooth_fields(rng)
    bars = stated(waved_scene(cameras, rng, 320, 10), rng, Misjudged(noise_px=0.2))
    frames = bars.correspondences.frames[:160]
    assert not said_of(with_waves(bars, fields, 0.5).of_frames(frames))


@pytest.mark.parametrize("number", [1, 2])
def test_bars_of_two_lengths_are_told(number: int) -> None:
    mistake = MISTAKES["another bar from half-way on"]
    assert "the bar is 0.8" in said_of(mistake.data(number))


def test_the_same_points_in_both_cameras_are_told() -> None:
    mistake = MISTAKES["the same points in both cameras"]
    assert "have exactly the same points" in said_of(mistake.data(0))


def test_a_turn_by_a_tenth_of_a_degree_in_a_real_recording_is_told() -> None:
    """It was silent; the recording as it is stays one."""
    data = read_dataset(SAMPLE)
    late = turned_after(data, "secondary", np.radians([0.1, 0.0, 0.0]), 300)
    found = re.search(r"moved between frames (\d+) and", said_of(late))
    assert found and abs(int(found[1]) - 300) < 25
    assert not said_of(data)
