"""What searches have found is stored to the last bit."""

import json
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

from stereocal.calibration.methods import CalibrationSettings
from stereocal.detection.detect import Detection, detect_targets, refusal
from stereocal.detection.target import Sighting, Spot
from stereocal.frames.search import pack_detection, unpack_detection
from stereocal.intrinsics.boards import BoardView, Refused, find_board
from stereocal.intrinsics.files import pack_board, unpack_board
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.photograph import read_photograph

SAMPLES = Path(__file__).parents[2] / "sample_data" / "photographs"


def bits(value: object) -> object:
    """A value to be compared to the last bit."""
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if is_dataclass(value):
        return [bits(getattr(value, field.name)) for field in fields(value)]
    if isinstance(value, list | tuple):
        return [bits(each) for each in value]
    return value.hex() if isinstance(value, float) else value


def test_detections_come_back_to_the_last_bit() -> None:
    image = read_photograph(SAMPLES / "primary" / "0001.jpg")
    detected = detect_targets(image), detect_targets(image[:400, :400])
    for found in (*detected, refusal((3, 2), "blurred", "x")):
        packed = pack_detection(found)
        assert packed is not None
        back = unpack_detection(packed)
        assert isinstance(back, Detection) and bits(back) == bits(found)
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
    assert isinstance(back, BoardView) and bits(back) == bits(found)
    refused = Refused("a", "no board", (3, 4))
    content = pack_board(refused)
    assert content is not None and unpack_board(content) == refused
    assert pack_board(Refused("a", "it cannot be read")) is None


def test_settings_that_are_read_in_part_are_written_whole() -> None:
    read = CalibrationSettings.from_json({"delta": 0.002})
    assert read.to_json() == {**CalibrationSettings().to_json(), "delta": 0.002}
