"""Data sets of any number of cameras and any rigid object."""

import json
import re
import tracemalloc
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from stereocal.fit.timing.to_calibrate import pair_to_calibrate
from stereocal.formats.camera_file import write_camera
from stereocal.formats.correspondences_csv import read_table, write_table
from stereocal.formats.dataset_files import (
    pack_dataset,
    pack_recording,
    parse_recording,
    read_dataset,
    read_recording,
)
from stereocal.rig.camera import CAMERAS
from stereocal.rig.pair import Pair
from stereocal.rig.recording import Recording
from stereocal.rig.rigid_object import BoardPattern, RigidObject
from tests.files import write
from tests.refused import refused
from tests.rigs.objects import BOARD, recorded

FIELD = read_dataset(Path(__file__).parents[2] / "sample_data" / "field")


TWO = replace(
    FIELD.changed(notes="windy").recording,
    cameras={"left": FIELD.primary, "right": FIELD.secondary},
    baselines_m={("left", "right"): FIELD.baseline_m},
)
THREE = replace(
    TWO,
    cameras={**TWO.cameras, "top": FIELD.primary},
    frame=np.append(TWO.frame, TWO.frame[0]),
    camera=np.append(TWO.camera, 2),
    target=np.append(TWO.target, TWO.target[0]),
    points=np.vstack([TWO.points, [[700.0, 500.0]]]),
    sigma_px=np.append(TWO.sigma_px, 0.25),
)
"""The third camera sees frame 1 alone."""
FILES = pack_recording(THREE)


def changed(**keys: Any) -> dict[str, bytes]:
    """The files of three cameras with other values in dataset.json; `...` leaves a key out."""
    description = {**json.loads(FILES["dataset.json"]), **keys}
    kept = {key: value for key, value in description.items() if value is not ...}
    return {**FILES, "dataset.json": json.dumps(kept).encode()}


def test_two_cameras_are_a_data_set_like_any_other(tmp_path: Path) -> None:
    write(pack_recording(TWO), tmp_path)
    found = read_dataset(tmp_path)
    assert found.sha256 == FIELD.sha256
    assert (found.name, found.notes) == (FIELD.name, "windy")
    assert found.baseline_sigma_m == FIELD.baseline_sigma_m
    assert read_dataset(tmp_path, pair="left-right").sha256 == FIELD.sha256


def test_a_pair_the_other_way_round_has_the_other_primary() -> None:
    found = pair_to_calibrate(parse_recording(FILES, "x"), "right-left")
    assert found.baseline_m == FIELD.baseline_m
    assert (found.correspondences.primary == FIELD.correspondences.secondary).all()


def test_more_cameras_ask_for_a_pair() -> None:
    with refused("3 cameras", "left-right (25 frames), left-top (1 frame), right-top"):
        pair_to_calibrate(parse_recording(FILES, "x"))
    with refused('"left-up"', "left-right (25 frames)"):
        pair_to_calibrate(parse_recording(FILES, "x"), "left-up")


def test_a_baseline_that_was_not_measured_is_free() -> None:
    free = parse_recording(changed(baselines_m=...), "x")
    assert free.pair("left", "right").baseline_is_free
    found = pair_to_calibrate(free, "left-right")
    assert found.baseline_is_free
    # The bars of 25 frames give the scale to a few mm; measured: 2 mm.
    assert found.baseline_m == pytest.approx(FIELD.baseline_m, rel=0.005)


@given(st.data())
@settings(max_examples=40)
def test_there_and_back(data: st.DataObject) -> None:
    """Any table of points is read as it was written, to the last bit."""
    names = st.sets(CAMERA_NAMES, min_size=2, max_size=4)
    cameras = dict.fromkeys(data.draw(names), FIELD.primary)
    begins = st.sampled_from(["", *"=+-@'", "'=", "''+", "-1", "\uff1d", "+."])
    some = st.builds("".join, st.tuples(begins, NAMES))
    targets = tuple(data.draw(st.sets(some, min_size=2, max_size=5)))
    keys = st.tuples(
        st.integers(-5, 1000), st.integers(0, len(cameras) - 1), st.integers(0, len(targets) - 1)
    )
    rows = np.array(data.draw(st.lists(keys, min_size=1, max_size=20, unique=True)))
    pixel = st.floats(-0.5, 1000)
    points = [[data.draw(pixel), data.draw(pixel)] for _ in rows]
    sigmas = st.one_of(st.just(np.nan), st.floats(1e-3, 5))
    places = np.array([[i, i * i, 0.1] for i in range(len(targets))], float)
    seen = [np.array(points), np.array([data.draw(sigmas) for _ in rows])]
    for number in range(len(cameras)):  # others are refused, as fractions of the image
        own = seen[0][rows[:, 1] == number]
        assume(len(own) < 4 or own.min() < 0 or own.max() > 1)
    one = Recording("any", cameras, RigidObject(targets, places, 0.01), *rows.T.copy(), *seen)
    files = pack_recording(one)
    assert not re.search(rb'[,\n]"?[=+@\xef]|[,\n]"?-[^\d]', files["points.csv"])
    back = parse_recording(files, "x")
    for name in ("frame", "camera", "target", "points", "sigma_px"):
        np.testing.assert_array_equal(getattr(back, name), getattr(one, name))
    assert list(back.cameras) == list(cameras)
    assert back.object.names == targets
    assert (back.object.points == one.object.points).all()


def words(others: str) -> st.SearchStrategy[str]:
    signs = st.characters(categories=("L", "N"), include_characters=others)
    return st.text(signs, min_size=1, max_size=8).map(lambda text: f"x{text}x")


# Without "-", which can give two pairs one name.
NAMES, CAMERA_NAMES = words("-_ .,;\"'"), words("_ .")


def test_a_board_is_described_by_its_pattern() -> None:
    board = BoardPattern(9, 6, 0.03, "DICT_4X4_50", 0.02)
    one = replace(THREE, object=RigidObject.of_board(board, 1e-4))
    back = parse_recording(pack_recording(one), "x").object
    assert (back.board, back.sigma_m, back.names[53]) == (board, 1e-4, "53")
    assert back.points[53] == pytest.approx([0.24, 0.15, 0.0])


def test_frames_without_a_common_point_are_named() -> None:
    with refused("left", "top"):
        apart = replace(THREE, frame=THREE.frame + 100 * (THREE.camera == 2))
        apart.pair("left", "top")


def test_read_from_a_folder(tmp_path: Path) -> None:
    write(FILES, tmp_path)
    assert read_recording(tmp_path).describe_pairs() == THREE.describe_pairs()


def test_a_board_before_cameras_started_by_hand_keeps_their_counts() -> None:
    own = recorded(BOARD, 6).recording
    data = Pair(replace(own, start_frames={"primary": 0, "secondary": -3}))
    back = parse_recording(pack_dataset(data), "x").pair(*CAMERAS)
    assert (back.sha256, back.start_frame) == (data.sha256, -3)


def test_a_table_of_two_cameras_says_where_targets_are_on_an_object() -> None:
    """The same data set, to its digest."""
    seen = np.random.default_rng(1).random((6, 35)) < 0.8
    data = recorded(BOARD, 6, seen=seen)
    bars, table = pack_dataset(FIELD), write_table(data.correspondences)
    lengths = {"baseline_m": data.baseline_m, "target_distance_m": data.target_distance_m}
    described = json.dumps({**json.loads(bars["dataset.json"]), **lengths}).encode()
    cameras = {f"{which}.json": write_camera(getattr(data, which)) for which in CAMERAS}
    files = {"dataset.json": described, **cameras, "correspondences.csv": table}
    back = parse_recording(files, "x").pair(*CAMERAS)
    assert back.sha256 == data.sha256
    own = back.correspondences.rigid_object
    assert own is not None
    assert own.names == BOARD.names
    assert own.half_turn.tolist() == [*range(35)][::-1]
    table = write_table(data.correspondences).replace(b",0.1,0.0,0.0\n", b",0.15,0.0,0.0\n", 1)
    with refused("target 1"):
        read_table(table, "x").strict("x")


def test_a_board_of_ten_thousand_corners_costs_what_was_seen() -> None:
    """Distances between all its corners took 800 MB each time, 6.5 GB in all."""
    tracemalloc.start()
    board = RigidObject.of_board(BoardPattern(100, 100, 0.01))
    assert board.half_turn.tolist() == [*range(10_000)][::-1]
    assert board.pairs_among(range(10_000)).tolist() == [[0, 9999], [99, 9900]]
    assert board.longest_m == pytest.approx(0.99 * np.sqrt(2))
    assert tracemalloc.get_traced_memory()[1] < 20e6  # measured 2.4 MB
    tracemalloc.stop()
