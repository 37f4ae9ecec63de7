"""Checkpoints of jobs: the same to the last bit."""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereocal.calibration.methods import CalibrationSettings
from stereocal.detection.detect import Detection, detect_targets, refusal
from stereocal.detection.fit import Corner
from stereocal.detection.target import Sighting, Spot
from stereocal.evaluation.evaluate import EvaluationSettings, Run, evaluate_runs
from stereocal.formats.evaluation_files import pack_runs, unpack_runs
from stereocal.frames.search import pack_detection, unpack_detection
from stereocal.intrinsics.boards import BoardView, Refused, find_board
from stereocal.intrinsics.files import pack_board, unpack_board, unpack_draws
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.board_pattern import BoardPattern
from stereocal.system.photograph import read_photograph
from stereocal.system.records import pack
from tests import known_rig as rig

SAMPLES = Path(__file__).parents[2] / "sample_data" / "photographs"


def same_runs(first: list[Run], second: list[Run]) -> bool:
    return len(first) == len(second) and all(
        getattr(a, name).dtype == getattr(b, name).dtype
        and getattr(a, name).tobytes() == getattr(b, name).tobytes()
        and getattr(a, name).shape == getattr(b, name).shape
        for a, b in zip(first, second, strict=True)
        for name in ("counts", "nans", "lengths", "angles", "correct_px")
    )


def test_runs_come_back_to_the_last_bit() -> None:
    settings = EvaluationSettings(calibration_frames=14, refined=RefineSettings())
    runs = evaluate_runs(rig.dataset(20, 0.3), settings, 0, range(3))
    assert same_runs(unpack_runs(pack_runs(runs)), runs)


def same_detections(first: Detection, second: Detection) -> bool:
    assert (first.targets is None) == (second.targets is None)
    for one, other in zip(first.targets or (), second.targets or (), strict=True):
        for field in fields(Corner):
            a, b = (np.asarray(getattr(corner, field.name)) for corner in (one, other))
            if a.tobytes() != b.tobytes() or a.dtype != b.dtype:
                return False
    for choice, its in zip(first.alternatives, second.alternatives, strict=True):
        if not same_detections(choice, its):
            return False
    own = ("targets", "alternatives")
    rest = [field.name for field in fields(Detection) if field.name not in own]
    return all(getattr(first, name) == getattr(second, name) for name in rest)


def test_detections_come_back_to_the_last_bit() -> None:
    image = read_photograph(SAMPLES / "primary" / "0001.jpg")
    for found in (
        detect_targets(image),
        detect_targets(image[:400, :400]),
        refusal((3, 2), "blurred", "x"),
    ):
        packed = pack_detection(found)
        assert packed is not None
        back = unpack_detection(packed)
        assert isinstance(back, Detection) and same_detections(back, found)
    sighting = Sighting((Spot(1 / 3, 2.0, 0.1, 9.0, ("x",)), None), "no B")
    packed_sighting = pack_detection(sighting)
    assert packed_sighting is not None and unpack_detection(packed_sighting) == sighting
    assert pack_detection(Sighting((None, None), "x", unreadable=True)) is None
    assert pack_detection(refusal((0, 0), "unreadable", "x")) is None
    assert packed is not None
    with pytest.raises(ValueError, match="magic"):
        unpack_detection(json.dumps({**json.loads(packed), "reason": "magic"}).encode())


def test_boards_come_back_to_the_last_bit() -> None:
    image = read_photograph(SAMPLES / "boards_primary" / "0001.jpg")
    found = find_board(image, BoardPattern(18, 12, 0.03), "é")
    assert isinstance(found, BoardView)
    packed = pack_board(found)
    assert packed is not None
    back = unpack_board(packed)
    assert isinstance(back, BoardView)
    assert (back.name, back.image_size, back.turned) == (found.name, found.image_size, found.turned)
    for name in ("ids", "corners"):
        assert getattr(back, name).tobytes() == np.ascontiguousarray(getattr(found, name)).tobytes()
    refused = Refused("a", "no board", (3, 4))
    content = pack_board(refused)
    assert content is not None and unpack_board(content) == refused
    assert pack_board(Refused("a", "it cannot be read")) is None


@given(st.lists(st.floats(), min_size=9, max_size=9))
def test_draws_come_back_to_the_last_bit(values: list[float]) -> None:
    draws = np.array([values])
    back = unpack_draws(pack(draws))
    assert np.array_equal(back, draws, equal_nan=True) and back.dtype == draws.dtype


def test_settings_that_are_read_in_part_are_written_whole() -> None:
    read = CalibrationSettings.from_json({"delta": 0.002})
    assert read.to_json() == {**CalibrationSettings().to_json(), "delta": 0.002}
