"""What searches have found is stored to the last bit."""

from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np

from stereocal.calibration.methods import CalibrationSettings
from stereocal.detection.detect import detect_targets
from stereocal.detection.target import Sighting, Spot
from stereocal.intrinsics.boards import BoardView, FoundBoard, Refused, find_board
from stereocal.projects.jobs import FoundBefore
from stereocal.projects.project import Project
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


def test_what_was_found_comes_back_to_the_last_bit(tmp_path: Path) -> None:
    target = read_photograph(SAMPLES / "primary" / "0001.jpg")
    board = read_photograph(SAMPLES / "boards_primary" / "0001.jpg")
    spot = Spot(1 / 3, 2.0, 0.1, 9.0, ("x",))
    results = [
        detect_targets(target).sighting,
        detect_targets(target[:400, :400]).sighting,
        Sighting((spot, None), "no B", alternatives=(Sighting((spot, spot), ""),)),
        find_board(board, BoardPattern(18, 12, 0.03), "é"),
        Refused("a", "no board", (3, 4)),
    ]
    assert isinstance(results[3], BoardView)
    unreadable = [Sighting((None, None), "x", unreadable=True), Refused("a", "it cannot be read")]
    database = Project.create(tmp_path).database
    for number, found in enumerate([*results, *unreadable]):
        of = Sighting if isinstance(found, Sighting) else FoundBoard
        FoundBefore(database, "photographs", of).keep(str(number), found)
        back = FoundBefore(database, "photographs", of).get(str(number))
        assert type(back) is type(found) if number < len(results) else back is None
        assert back is None or bits(back) == bits(found)


def test_settings_that_are_read_in_part_are_written_whole() -> None:
    read = CalibrationSettings.from_json({"delta": 0.002})
    assert read.to_json() == {**CalibrationSettings().to_json(), "delta": 0.002}
