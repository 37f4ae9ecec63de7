"""Which columns name tracks, where tracks end, and whether frames follow each other."""

from __future__ import annotations

import numpy as np
import pandas as pd

from stereocal.matching.lengths import track_columns, tracks_by, usual_tracks


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
