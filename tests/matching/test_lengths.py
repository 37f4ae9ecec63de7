"""Known lengths between measured points; which columns name tracks, and where tracks end."""

import numpy as np
import pandas as pd
import pytest

from stereocal.errors import StereocalError
from stereocal.matching.lengths import check_lengths, has_two_a_frame
from stereocal.matching.trajectories import (
    ONE_A_FRAME,
    track_columns,
    tracks_by,
    usual_tracks,
    with_track,
)
from tests.refused import refused


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
    assert "The mean distance in 2 frames is 1.050 m" in check.sentence()
    assert "5.00 % too long" in check.sentence()


def test_the_two_points_of_a_frame_need_no_names() -> None:
    assert has_two_a_frame(BIRDS)
    np.testing.assert_allclose(check_lengths(BIRDS, 1.0).lengths_m, [1.0, 1.1], rtol=1e-12)
    three = points((1, 0.0, "a"), (1, 1.0, "b"), (1, 2.0, "c"))
    assert not has_two_a_frame(three)
    with pytest.raises(StereocalError):
        check_lengths(three, 1.0)


def test_a_name_twice_in_a_frame_is_left_out_and_said() -> None:
    twice = pd.concat([BIRDS, points((2, 9.0, "a"))], ignore_index=True)
    check = check_lengths(twice, 1.0, "bird", ("a", "b"))
    assert check.frames.tolist() == [1]
    assert "1 frame was left out" in check.sentence()


@pytest.mark.parametrize(
    ("known", "ends", "said"),
    [
        (0.0, ("a", "b"), ["0 m"]),
        (-1.0, ("a", "b"), ["above 0"]),
        (1.0, ("a", "a"), ["points"]),
        (1.0, ("a", "z"), ["frame"]),
    ],
)
def test_refused(known: float, ends: tuple[str, str], said: list[str]) -> None:
    with refused(*said):
        check_lengths(BIRDS, known, "bird", ends)


def flight(frames: int = 30, birds: int = 3, step: int = 1) -> pd.DataFrame:
    """Birds on straight ways, with a column that names no bird."""
    frame = np.repeat(np.arange(frames) * step, birds)
    bird = np.tile(np.arange(birds), frames)
    return pd.DataFrame(
        {
            "frame": frame,
            "x": 0.1 * frame + bird,
            "y": 1.0 * bird,
            "z": 8.0 + 0.05 * frame,
            "error_px": 0.1,
            "camera": "left",
            "bird": [f"b{k}" for k in bird],
        }
    )


def test_a_column_that_names_each_bird_once_a_frame_gives_tracks() -> None:
    points = flight()
    assert track_columns(points) == ["bird"]
    tracks = tracks_by(points, "bird")
    assert [len(track) for track in tracks] == [30, 30, 30]
    assert points["bird"].iloc[tracks[1]].unique().tolist() == ["b1"]
    assert usual_tracks(points) == "bird"


def test_a_track_ends_where_frames_or_positions_are_missing() -> None:
    points = flight(birds=1, step=5)
    points = points[points["frame"] != 50].reset_index(drop=True)
    points.loc[points["frame"] == 100, "x"] = np.nan
    assert [len(track) for track in tracks_by(points, "bird")] == [10, 9, 9]
    assert tracks_by(points.iloc[:1], "bird") == []


def test_points_at_random_positions_are_not_connected() -> None:
    points = flight()
    points[["x", "y", "z"]] = np.random.default_rng(3).uniform(-1, 1, (len(points), 3))
    assert track_columns(points) == ["bird"]
    assert usual_tracks(points) is None
    assert usual_tracks(flight(frames=3)) is None  # too short to tell


def test_the_trajectories_that_are_drawn_are_in_the_table() -> None:
    named = with_track(flight())
    assert named["track"].tolist() == named["bird"].tolist()
    alone = flight(birds=1, step=5).drop(columns="bird")
    alone = with_track(alone[alone["frame"] != 50].reset_index(drop=True))
    tracks = tracks_by(alone, ONE_A_FRAME)
    assert [alone["track"].iloc[rows].unique().tolist() for rows in tracks] == [[1], [2]]
    random = flight()
    random[["x", "y", "z"]] = np.random.default_rng(3).uniform(-1, 1, (len(random), 3))
    assert "track" not in with_track(random)


def test_a_track_of_one_name_in_both_cameras_is_one_however_short() -> None:
    short = flight(frames=2).rename(columns={"bird": "track_id_primary"})
    short["track_id_secondary"] = short["track_id_primary"].where(short["frame"] != 1, "b7")
    found = with_track(short)
    same = short["track_id_primary"] == short["track_id_secondary"]
    assert same.any() and not same.all()
    assert found["track"].tolist() == short["track_id_primary"].where(same, "").tolist()
    # Counted differently in each camera, they name nothing.
    apart = short.assign(track_id_secondary="other")
    assert "track" not in with_track(apart)
