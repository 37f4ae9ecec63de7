"""Rigid objects: known distances, parts of a frame, and what the methods take of them."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stereocal.formats.dataset_files import pack_dataset, parse_recording
from stereocal.rig.camera import CAMERAS
from stereocal.rig.rigid_object import MOST_PAIRS, RigidObject
from tests.refused import refused
from tests.rigs.objects import BOARD, WAND, recorded

places = st.tuples(*[st.floats(-0.5, 0.5).map(lambda x: round(x, 3))] * 3)
objects = st.lists(places, min_size=2, max_size=9, unique=True).map(
    lambda points: RigidObject(tuple(map(str, range(len(points)))), np.array(points))
)


@given(objects, st.data())
def test_known_distances_are_disjoint_and_the_longest(
    own: RigidObject, data: st.DataObject
) -> None:
    seen = data.draw(st.sets(st.integers(0, len(own.names) - 1), min_size=1))
    pairs = own.pairs_among(seen)
    assert len(pairs) == min(MOST_PAIRS, len(seen) // 2)
    assert len({*pairs.ravel().tolist()}) == 2 * len(pairs) and {*pairs.ravel().tolist()} <= seen
    if len(pairs):
        a, b = np.array([*combinations(sorted(seen), 2)]).T
        assert own.distance(*pairs[0]) == own.distance(a, b).max()


@given(objects, st.data())
def test_every_point_is_in_one_part_of_its_frame(own: RigidObject, data: st.DataObject) -> None:
    """Parts divide each frame; only pairs with a known distance share one."""
    k = len(own.names)
    seen = np.array(
        data.draw(st.lists(st.lists(st.booleans(), min_size=k, max_size=k), min_size=1))
    )
    if not seen.any():
        return
    rows = recorded(own, len(seen), seen=seen).correspondences
    part, place = rows.parts
    assert {*part.tolist()} == {*range(part.max() + 1)}
    for number in range(part.max() + 1):
        of_part = np.flatnonzero(part == number)
        assert len({*rows.frame[of_part].tolist()}) == 1
        assert sorted(place[of_part]) == [*range(len(of_part))]
    sizes = np.bincount(part)
    assert (
        rows.bars
        == np.array([np.flatnonzero(part == n) for n in np.flatnonzero(sizes == 2)]).reshape(-1, 2)
    ).all()
    first = np.array([rows.frame[part == n][0] for n in range(part.max() + 1)])
    assert (np.diff(first) >= 0).all()


def test_a_wand_and_a_board() -> None:
    assert WAND.pairs_among(range(3)).tolist() == [[0, 2]]
    assert WAND.pairs_among([1, 2]).tolist() == [[1, 2]]
    assert BOARD.pairs_among(range(35)).tolist() == [[0, 34], [6, 28]]
    data = recorded(BOARD, 4)
    assert data.bar_distances_m == pytest.approx([float(BOARD.distance(0, 34))] * 8)
    assert len(data.correspondences.bars) == 8


def test_an_object_turned_the_other_way() -> None:
    data = recorded(BOARD, 3).with_targets_exchanged([2])
    rows, before = data.correspondences, recorded(BOARD, 3).correspondences
    second = rows.frame == 2
    assert (rows.secondary[second] == before.secondary[second][::-1]).all()
    assert (rows.secondary[~second] == before.secondary[~second]).all()
    assert WAND.half_turn.tolist() == [2, 1, 0]


def test_a_data_set_of_an_object_is_written_and_read() -> None:
    seen = np.random.default_rng(0).random((6, 35)) < 0.7
    data = recorded(BOARD, 6, seen=seen)
    back = parse_recording(pack_dataset(data), "x").pair(*CAMERAS)
    assert back.sha256 == data.sha256
    assert back.target_distance_sigma_m == data.target_distance_sigma_m
    assert back.correspondences.rigid_object is not None
    assert back.correspondences.rigid_object.board == BOARD.board
    free = recorded(WAND, 8).changed(baseline_sigma_m=np.inf)
    assert parse_recording(pack_dataset(free), "x").pair(*CAMERAS).baseline_is_free


def test_the_object_is_part_of_the_digest() -> None:
    other = RigidObject(WAND.names, 1.001 * WAND.points)
    assert recorded(WAND).sha256 != recorded(WAND, stated=other).sha256


def test_a_target_that_the_object_does_not_have() -> None:
    rows = recorded(WAND, 3).correspondences
    with refused("target", "A, M, B"):
        replace(rows, target=rows.target + 1)
