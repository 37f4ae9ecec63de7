"""Known lengths between measured points, and what the Apply page reads of other programs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from stereocal.errors import StereocalError
from stereocal.formats.point_answers import (
    UNKNOWN,
    Answers,
    BarAnswers,
    answered,
    bars_of,
    column_names,
    first_answers,
    holds_bars,
    layout_of,
)
from stereocal.formats.point_files import read_points
from stereocal.matching.lengths import check_lengths, has_two_a_frame


def points(*rows: tuple[int, float, str]) -> pd.DataFrame:
    """Frame, x and name; y and z are 0 and 1."""
    table = pd.DataFrame(rows, columns=["frame", "x", "bird"])
    return table.assign(y=0.0, z=1.0, error_px=0.1)


BIRDS = points((1, 0.0, "a"), (1, 1.0, "b"), (2, 0.0, "b"), (2, 1.1, "a"), (3, 5.0, "a"))


def test_distance_of_two_named_points() -> None:
    check = check_lengths(BIRDS, 1.0, "bird", ("a", "b"))
    assert check.frames.tolist() == [1, 2]
    np.testing.assert_allclose(check.lengths_m, [1.0, 1.1], rtol=1e-12)
    assert check.mean_error == pytest.approx(0.05)
    assert "The mean distance in 2 frames is 1.0500 m" in check.sentence()
    assert "5.00 % too long" in check.sentence()


def test_the_two_points_of_a_frame_need_no_names() -> None:
    assert has_two_a_frame(BIRDS)
    np.testing.assert_allclose(check_lengths(BIRDS, 1.0).lengths_m, [1.0, 1.1], rtol=1e-12)
    three = points((1, 0.0, "a"), (1, 1.0, "b"), (1, 2.0, "c"))
    assert not has_two_a_frame(three)
    with pytest.raises(StereocalError, match="No frame has both points"):
        check_lengths(three, 1.0)


def test_a_name_twice_in_a_frame_is_left_out_and_said() -> None:
    twice = pd.concat([BIRDS, points((2, 9.0, "a"))], ignore_index=True)
    check = check_lengths(twice, 1.0, "bird", ("a", "b"))
    assert check.frames.tolist() == [1]
    assert "1 frames were left out" in check.sentence()


@pytest.mark.parametrize(
    ("known", "ends", "sentence"),
    [
        (0.0, ("a", "b"), "known length is 0 m"),
        (-1.0, ("a", "b"), "must be a length above 0"),
        (1.0, ("a", "a"), "two points are the same"),
        (1.0, ("a", "z"), "No frame has both points"),
    ],
)
def test_refused(known: float, ends: tuple[str, str], sentence: str) -> None:
    with pytest.raises(StereocalError, match=sentence):
        check_lengths(BIRDS, known, "bird", ends)


ODD = b"when;across;down;weight\n7;10,5;20;heavy\n8;11,5;21;light\n"


def test_columns_chosen_by_hand() -> None:
    layout = layout_of(ODD, "odd.csv")
    assert layout.program == UNKNOWN and layout.header_rows == 1
    assert column_names(ODD, layout, "odd.csv")[1] == "2: across"
    proposed = first_answers(layout, 0)
    assert proposed.columns is None
    with pytest.raises(StereocalError, match="choose the columns"):
        answered(layout, proposed, ODD, "odd.csv")
    answers = replace(proposed, columns=(0, 1, 2))
    moved = replace(answers, first_pixel=0.5, px_per_unit=2.0)
    table = read_points(ODD, answered(layout, moved, ODD, "odd.csv"), "cam1")
    assert table.to_dict("list") == {
        "frame": [7, 8],
        "u": [20.5, 22.5],
        "v": [39.5, 41.5],
        "weight": ["heavy", "light"],
    }
    counted = replace(answers, columns=(None, 1, 2))
    table = read_points(ODD, answered(layout, counted, ODD, "odd.csv"), "cam1")
    assert table["frame"].tolist() == [1, 2]
    assert Answers.from_json(moved.to_json()) == moved


def test_answers_of_another_version() -> None:
    good = Answers("cam1").to_json()
    for bad in ({**good, "corner": "middle"}, {**good, "more": 1}, {"camera": "cam1"}):
        with pytest.raises(StereocalError, match="answers of"):
            Answers.from_json(bad)


def test_which_files_hold_bars() -> None:
    wand = b"1,2,3,4,5,6,7,8\n1,2,3,4,5,6,7,8\n"
    assert holds_bars(wand, "wand.csv")
    assert not holds_bars(ODD, "odd.csv")
    assert not holds_bars(b"frame,target,u_primary\n1,A,3\n", "ours.csv")
    assert not holds_bars(b"", "empty.csv")
    answers = BarAnswers(("cam1", "cam1"), ("A", "B"))
    with pytest.raises(StereocalError, match="two cameras are the same"):
        bars_of(wand, answers, "wand.csv")
    rows = bars_of(wand, replace(answers, cameras=("cam2", "cam1")), "wand.csv")
    assert rows.primary[0].tolist() == [3, 4] and rows.secondary[2].tolist() == [5, 6]
