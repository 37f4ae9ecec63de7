"""The entry "window" of `dataset.json`."""

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from stereocal.formats.dataset_files import pack_dataset, pack_recording, parse_recording
from stereocal.rig.recording import Recording
from stereocal.rig.window import StatedWindow, Window
from tests.refused import refused
from tests.rigs.behind_glass import Tank, submerged

TANK = submerged(Tank(), np.random.default_rng(1), bars=5)
KNOWN = {"distance_m": 0.4, "normal": (0.0, 0.0, 1.0), "distance_sigma_m": 0.003}
FILES = pack_recording(TANK.recording)


def with_window(stated: Any) -> Recording:
    """The recording of files that state this."""
    description = {**json.loads(FILES["dataset.json"]), "window": stated}
    return parse_recording({**FILES, "dataset.json": json.dumps(description).encode()}, "t.zip")


@pytest.mark.parametrize("each", [False, True])
def test_windows_of_a_recording_are_read_back(each: bool) -> None:
    tank = submerged(Tank(each=each, cameras=3), np.random.default_rng(2), bars=5)
    for known in ({}, KNOWN):
        asked = tank.asked(**known, medium_sigma=0.001)
        read = parse_recording(pack_recording(asked), "t.zip")
        assert read.windows == asked.windows and read.sha256 == asked.sha256


def test_windows_of_two_cameras_are_read_back_under_the_names_of_the_format() -> None:
    asked = TANK.asked(**KNOWN)
    two = replace(asked, baselines_m={("c1", "c2"): 0.3}, baseline_sigma_m=None).pair("c1", "c2")
    files = pack_dataset(two)
    assert json.loads(files["dataset.json"])["format"] == "stereocal-dataset/1"
    read = parse_recording(files, "t.zip")
    assert read.windows == (replace(asked.windows[0], cameras=("primary", "secondary")),)
    assert parse_recording(pack_dataset(read.pair(*read.cameras)), "t.zip").windows == read.windows


def test_one_window_is_of_all_cameras_unless_it_names_some() -> None:
    read = with_window({"thickness_m": 0.02, "normal": [0, 0, 2]}).windows
    assert read == (StatedWindow(("c1", "c2"), 0.02, normal=(0.0, 0.0, 1.0)),)
    one = {"cameras": ["c2"], "medium": 1.34}
    assert with_window(one).windows == (StatedWindow(("c2",), medium=1.34),)
    assert with_window([one, {"cameras": ["c1"], "medium": 1}]).windows[0].cameras == ("c2",)


@pytest.mark.parametrize("stated", [None, {"medium": 1.0}, {"medium": 1}, []])
def test_air_is_no_window(stated: Any) -> None:
    read = with_window(stated)
    assert not read.has_windows and read.sha256 == TANK.recording.sha256
    assert pack_recording(read) == FILES


WRONG: list[tuple[Any, str]] = [
    ({"tickness_m": 0.01}, "unknown: tickness_m ... Write"),
    ({"thickness_m": "10 mm"}, "thickness_m ... Write"),
    ({"cameras": "c1"}, "cameras ... Write"),
    ({"normal": [0, 1]}, "normal ... Write"),
    ("water", "must be an object ... Write"),
    (True, "must be an object"),
    ({"cameras": ["c1", "c9"]}, '"c9": there are c1, c2'),
    ({"cameras": []}, "must name its cameras"),
    ([{"cameras": ["c1"]}, {"cameras": ["c1"]}], "two windows name the camera c1"),
    ([{"cameras": ["c1"]}, {}], "entry 2: each of several must name"),
    ({"cameras": ["c2", "c1"]}, "another order"),
    ({"medium": 13.33}, "between 1 and 2.5"),
    ({"medium": float("nan")}, "two indices"),
    ({"glass": 0.5}, "between 1 and 2.5"),
    ({"thickness_m": 10}, "is 10 m: it must be in metres"),
    ({"thickness_m": -0.1}, "thickness 0 m or more"),
    ({"distance_m": 0}, "distance must be above 0 m"),
    ({"normal": [0, 0, -1]}, "point away from its camera"),
    ({"normal": [0, 0, 0]}, "normal"),
    ({"medium_sigma": -0.1}, "standard error of a window"),
    ({"distance_sigma_m": 0.01}, "no distance_m: state both"),
    ({"normal_sigma_deg": 1.0}, "no normal: state both"),
]


@pytest.mark.parametrize(("stated", "message"), WRONG)
def test_a_wrong_window_is_refused(stated: Any, message: str) -> None:
    with refused("t.zip: dataset.json: ", *message.split(" ... ")):
        with_window(stated)


def test_a_camera_has_one_window() -> None:
    known = Window((0.0, 0.0, 1.0), 0.4)
    cameras = {name: replace(it, window=known) for name, it in TANK.recording.cameras.items()}
    files = pack_recording(replace(TANK.recording, cameras=cameras))
    assert parse_recording(files, "t.zip").cameras["c1"].window == known
    stated = {**json.loads(files["dataset.json"]), "window": {}}
    with refused("file of the camera c1 has a window already"):
        parse_recording({**files, "dataset.json": json.dumps(stated).encode()}, "t.zip")


def test_a_slip_of_the_pen_is_named() -> None:
    description = {**json.loads(FILES["dataset.json"]), "windows": {}}
    with refused('"windows" is not known: write "window"'):
        parse_recording({**FILES, "dataset.json": json.dumps(description).encode()}, "t.zip")
