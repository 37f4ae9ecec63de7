"""Boards that are numbered or stated wrongly are named before a pose is looked for."""

from dataclasses import replace

import numpy as np
import pytest

from stereocal.calibration.board_numbering import check_numbering, note_on_ways_round
from stereocal.calibration.corrections import fewer_corners
from stereocal.errors import StereocalError
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.workflow.pair_run import PairRun
from tests.further import further
from tests.refused import refused
from tests.rigs.board_pairs import BoardPair, sound
from tests.rigs.mistakes import MISTAKES, from_the_right, of_points

PAIR, EVEN_ROWS, OTHER_SIZE = (
    sound(number, frames=6, baseline=number == 6) for number in (0, 2, 6)
)


@pytest.mark.parametrize(
    "mistake, pair",
    [
        ("a column too many", PAIR),
        ("a column too few", PAIR),
        ("rows and columns exchanged", PAIR),
        ("rows and columns exchanged in one camera", PAIR),
        ("half a turn of one camera", EVEN_ROWS),
        ("corners of one camera mirrored", PAIR),
        ("one frame less", PAIR),
        *further(
            ("corners of one camera from the last row", PAIR),
            ("one file for all cameras", OTHER_SIZE),
            ("all points at 75 %", PAIR),
            ("one frame less", sound(0, frames=12)),
        ),
    ],
)
def test_mistake_is_named_first(mistake: str, pair: BoardPair) -> None:
    it = MISTAKES[mistake]
    with pytest.raises(StereocalError) as error:
        _ = PairRun(with_baseline_found(it.of_board(pair, np.random.default_rng(1)))).inputs
    first, *_ = str(error.value).lower().split(". ")
    assert any(word in first for word in it.words)


def test_sound_numbers_pass_and_other_ways_round_are_told() -> None:
    check_numbering(PAIR.recording)
    assert not note_on_ways_round(PAIR.recording)
    one, both = (of_points(from_the_right, each) for each in (False, True))
    mirrored = both(PAIR.recording, np.random.default_rng(1))
    check_numbering(mirrored)
    assert "mirrored" in note_on_ways_round(mirrored)
    # One camera alone is no such case.
    alone = one(PAIR.recording, np.random.default_rng(1))
    assert not note_on_ways_round(alone)


def test_misnumbered_camera_is_named() -> None:
    grid = np.arange(35).reshape(5, 7)
    points = PAIR.points.copy()
    points[:, :, 1] = PAIR.points[:, grid.T.ravel(), 1]
    with refused("secondary camera", "7 columns and 5 rows", "row had 5"):
        check_numbering(replace(PAIR, points=points).recording)


def test_fewer_corners_keep_the_outermost() -> None:
    data = PAIR.dataset
    few = fewer_corners(data)
    assert len(few.correspondences) < len(data.correspondences)
    assert np.array_equal(few.bar_distances_m, data.bar_distances_m)


def test_corners_at_one_place_tell_no_numbers() -> None:
    points = PAIR.points.copy()
    points[:, :34:2] = points[:, 1:35:2]
    check_numbering(replace(PAIR, points=points).recording)
