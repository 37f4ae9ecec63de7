"""The column `time_frame` of a table of points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stereocal.errors import StereocalError
from stereocal.formats.correspondences_csv import TEMPLATE, read_table, write_table
from stereocal.rig.tracks import TimeOffset
from tests import known_rig as rig

LINES = TEMPLATE.splitlines()


def with_times(times: list[str]) -> bytes:
    rows = [",".join(pair) for pair in zip(LINES[1:], times, strict=True)]
    return "\n".join([f"{LINES[0]},time_frame", *rows]).encode()


def test_it_is_read_and_written_back() -> None:
    rows = read_table(with_times(["7", "7", "12", "12"]), "t").strict("t")
    assert rows.time_frame.tolist() == [7, 7, 12, 12]
    again = read_table(write_table(rows), "t").strict("t")
    assert again.time_frame.tolist() == [7, 7, 12, 12]


def test_without_it_the_frame_is_the_time() -> None:
    rows = read_table(TEMPLATE.encode(), "t").strict("t")
    assert rows.time_frame.tolist() == rows.frame.tolist()
    assert b"time_frame" not in write_table(rows)


@pytest.mark.parametrize("times", [["7", "8", "12", "12"], ["7", "7", "7", "7"]])
def test_contradictory_ones_are_rejected(times: list[str]) -> None:
    with pytest.raises(StereocalError, match="time_frame"):
        read_table(with_times(times), "t")


def test_one_that_is_no_whole_number_is_named() -> None:
    problems = read_table(with_times(["7", "7", "x", "12"]), "t").problems
    assert [problem.line for problem in problems] == [4]


def test_a_shifted_data_set_is_written_as_recorded_and_has_the_same_digest() -> None:
    data = rig.dataset(12)
    shifted = data.shifted(TimeOffset(0.01))
    assert shifted.sha256 == data.sha256
    assert write_table(shifted.correspondences) == write_table(data.correspondences)
    times = replace(data.correspondences, time_frame=data.correspondences.frame + 3)
    assert replace(data, correspondences=times).sha256 != data.sha256
    assert np.isnan(data.correspondences.motion).all()
