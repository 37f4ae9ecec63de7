"""The figures of the Apply page: what they draw, and that their sentences say the same."""

import re

import numpy as np
import pandas as pd
import plotly.graph_objects as go
import pytest

from stereocal.figures.matches import describe_matches, plot_matches
from stereocal.figures.measured import describe_points, plot_points
from stereocal.figures.space import HALF_VIEW, NARROW, VIEWS
from stereocal.library.tables import match, reconstruct
from stereocal.matching.matching import nearest_errors
from stereocal.matching.point_table import pixels_of
from stereocal.matching.threshold import Shares, ThresholdChoice
from stereocal.matching.trajectories import tracks_by
from stereocal.rig.camera import CAMERAS
from stereocal.rig.geometry import Pose
from stereocal.rig.parameters import RigParameters
from tests.matching.test_point_noise import sample
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY, bar_ends, images

SET = RigParameters(PRIMARY, SECONDARY, RIG, "2d", 1.0, {}, {}, matching_threshold_px=0.8)
FRAMES = 8


def two_tables() -> tuple[pd.DataFrame, pd.DataFrame]:
    """The bar's ends in both cameras, with one point that the other camera did not see."""
    names = {"frame": np.repeat(np.arange(1, FRAMES + 1), 2), "end": ["A", "B"] * FRAMES}
    first, second = (
        pd.DataFrame({**names, "u": side[:, 0], "v": side[:, 1]})
        for side in images(bar_ends(FRAMES))
    )
    alone = pd.DataFrame({"frame": [1], "end": ["C"], "u": [12.0], "v": [34.0]})
    return pd.concat([first, alone], ignore_index=True), second.drop(index=3)


PRIMARY_TABLE, SECONDARY_TABLE = two_tables()
PAIRS = match(SET, PRIMARY_TABLE, SECONDARY_TABLE)
POINTS = reconstruct(SET, PAIRS)
NEAREST = nearest_errors(SET, sample((PRIMARY_TABLE, SECONDARY_TABLE)))
CHOICE = ThresholdChoice(0.5, None, None, Shares(0.01, 0.02))


def traces(figure: go.Figure, name: str) -> list[go.Scatter]:
    return [trace for trace in figure.data if str(trace.name).startswith(name)]


def test_matches_of_a_frame() -> None:
    of_frame = PAIRS[PAIRS["frame"] == 1]
    first = pixels_of(PRIMARY_TABLE[PRIMARY_TABLE["frame"] == 1])
    second = pixels_of(SECONDARY_TABLE[SECONDARY_TABLE["frame"] == 1])
    figures = [
        plot_matches(of_frame, seen, side, SET.primary.image_size)
        for side, seen in zip(CAMERAS, (first, second), strict=True)
    ]
    hollow = [traces(figure, "No partner")[0] for figure in figures]
    assert [len(trace.x) for trace in hollow] == [1, 0]
    assert (hollow[0].x[0], hollow[0].y[0]) == (12.0, 34.0)
    assert all("open" in trace.marker.symbol for trace in hollow)
    left, right = (traces(figure, "Pair")[0] for figure in figures)
    ordered = of_frame.sort_values("u_primary")
    np.testing.assert_array_equal(left.x, ordered["u_primary"])
    np.testing.assert_array_equal(right.x, ordered["u_secondary"])
    assert list(left.text) == list(right.text) == ["1", "2"]
    np.testing.assert_array_equal(left.marker.color, right.marker.color)
    said = describe_matches(of_frame, dict(zip(CAMERAS, (first, second), strict=True)), 1)
    assert "1 of 3 points of the primary" in said
    one = {str(side): seen[:1] for side, seen in zip(CAMERAS, (first, second), strict=True)}
    assert "of 1 point of the primary" in describe_matches(of_frame[:0], one, 1)
    for figure in figures:
        assert figure.layout.yaxis.range[0] > figure.layout.yaxis.range[1]  # v downwards
        assert not figure.layout.images


@pytest.mark.parametrize("colour", ["frame", "error"])
def test_points_in_space(colour: str) -> None:
    figure = plot_points(POINTS, "frame" if colour == "frame" else "error", SET)
    (cloud,) = traces(figure, "Points")
    (centre,) = traces(figure, "optical centre, secondary")
    np.testing.assert_array_equal(cloud.y, POINTS["z"])
    np.testing.assert_array_equal(cloud.z, -POINTS["y"])
    np.testing.assert_allclose(centre.y, RIG.inverse().T[2])
    assert figure.layout.scene.aspectmode == "data"
    values = POINTS["frame" if colour == "frame" else "error_px"]
    np.testing.assert_array_equal(cloud.marker.color, values)
    assert describe_points(POINTS).startswith(f"{len(POINTS)} points of {FRAMES} frames")


def test_digits_suit_the_size_of_a_scene_and_frames_are_whole() -> None:
    small = POINTS.assign(**{axis: POINTS[axis] / 1000 for axis in "xyz"})
    far = re.search(r"depth z from \S+ to (\S+) m", describe_points(small))
    assert far and len(far[1].lstrip("0.")) == 4  # 0.01 m would say nothing
    few = POINTS[POINTS["frame"] < POINTS["frame"].min() + 3]
    bars = [
        each.marker.colorbar
        for each in plot_points(few, "frame", SET).data
        if each.marker.showscale
    ]
    assert [bar.dtick for bar in bars] == [1]


def test_points_in_a_world_frame_stand_upright() -> None:
    """The scene is the same, turned: z of the table is up, and the cameras move with it."""
    level = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    world = Pose(level, np.array([10.0, 20.0, 1.5]))
    moved = POINTS.copy()
    moved[["x", "y", "z"]] = world.apply(POINTS[["x", "y", "z"]])
    figure = plot_points(moved, "frame", SET, world=world)
    (cloud,) = traces(figure, "Points")
    for axis in "xyz":
        np.testing.assert_allclose(cloud[axis], moved[axis])
    for name, centre in (("primary", np.zeros(3)), ("secondary", RIG.inverse().T)):
        (drawn,) = traces(figure, f"optical centre, {name}")
        found = [drawn[axis][0] for axis in "xyz"]
        np.testing.assert_allclose(found, world.apply(centre), atol=1e-12)
    assert figure.layout.scene.zaxis.title.text == "z (m)"
    assert "(down)" not in cloud.hovertemplate
    eye, before = (each.layout.scene.camera for each in (figure, plot_points(POINTS, "frame", SET)))
    assert eye.up.z == pytest.approx(before.up.z)
    assert eye.eye.z == pytest.approx(before.eye.z)  # as high above the scene
    assert "depth" not in describe_points(moved, world=world)
    views = {
        str(plot_points(moved, "error", SET, v, world=world).layout.scene.camera) for v in VIEWS
    }
    assert len(views) == len(VIEWS)


def test_tracks_are_one_trace_with_gaps_and_the_frame_is_marked() -> None:
    tracks = tracks_by(POINTS, "end_primary")
    figure = plot_points(POINTS, "error", SET, "Side", tracks, 3)
    (lines,) = traces(figure, "Tracks")
    assert np.isnan(lines.x).sum() == len(tracks)
    np.testing.assert_array_equal(lines.y[: len(tracks[0])], POINTS["z"].iloc[tracks[0]])
    (marked,) = traces(figure, "Frame 3")
    np.testing.assert_array_equal(marked.y, POINTS.loc[POINTS["frame"] == 3, "z"])
    assert f"lines connect them to {len(tracks)} tracks" in describe_points(POINTS, tracks)
    eyes = {str(plot_points(POINTS, "error", SET, v).layout.scene.camera) for v in VIEWS}
    assert len(eyes) == len(VIEWS)


def test_cameras_near_their_points_are_in_view_with_their_names_and_far_ones_have_none() -> None:
    figure = plot_points(POINTS, "frame", SET)
    named = traces(figure, "optical centre")
    # The higher one's name is above it, the other's below it: neither is on what is between them.
    high_first = sorted(named, key=lambda trace: -trace.z[0])
    assert [trace.textposition.split()[0] for trace in high_first] == ["top", "bottom"]
    for camera in CAMERAS:
        (centre,) = traces(figure, f"optical centre, {camera}")
        assert centre.text[0] == camera
        # A third of the half view is left beside it, for the name.
        across, above = place_in_view(figure, np.array([centre.x[0], centre.y[0], centre.z[0]]))
        assert abs(across) < 0.7 * NARROW and abs(above) < 0.7
    far = POINTS.assign(x=0.01 * POINTS["x"], y=0.01 * POINTS["y"], z=50 + 0.01 * POINTS["z"])
    figure = plot_points(far, "frame", SET)
    assert [trace.text[0] for trace in traces(figure, "optical centre")] == ["", ""]


def place_in_view(figure: go.Figure, point: np.ndarray) -> tuple[float, float]:
    """Where a point is drawn: right and up of the middle, in halves of the view's height."""
    scene = figure.layout.scene
    ends = np.array([scene[f"{axis}axis"].range for axis in "xyz"])
    middle, unit = ends.mean(axis=1), np.cbrt(np.prod(np.ptp(ends, axis=1)))
    eye, centre, up = (
        np.array([part.x, part.y, part.z])
        for part in (scene.camera.eye, scene.camera.center, scene.camera.up)
    )
    away = (eye - centre) / np.linalg.norm(eye - centre)
    across = np.cross(up, away) / np.linalg.norm(np.cross(up, away))
    seen = (point - middle) / unit - eye
    reach = -(seen @ away) * HALF_VIEW
    return float(seen @ across / reach), float(seen @ np.cross(away, across) / reach)
