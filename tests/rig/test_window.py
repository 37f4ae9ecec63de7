"""Flat windows: rays in the medium, images of points, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Pose
from stereocal.rig.window import (
    StatedWindow,
    Window,
    check_windows,
    moved_window,
    rays_through,
    seen_through,
    windows_of_some,
)

K = np.array([[900.0, 1.5, 630.0], [0.0, 905.0, 500.0], [0.0, 0.0, 1.0]])
TANK = Window((0.2, -0.1, 1.0), 0.4, 0.02, 1.52, 1.333)
CAMERA = Camera(K, np.array([-0.1, 0.05, 0.001, 0.0]), (1280, 1024), window=TANK)


@settings(max_examples=60, deadline=None)
@given(
    tilt=st.tuples(st.floats(-0.8, 0.8), st.floats(-0.8, 0.8)),
    distance=st.floats(0.01, 2.0),
    thickness=st.floats(0.0, 0.05),
    indices=st.tuples(st.floats(1.0, 1.8), st.floats(1.0, 1.6)),
    away=st.floats(0.01, 20.0),
)
def test_the_image_of_a_point_of_a_ray_is_its_pixel(
    tilt: tuple[float, float],
    distance: float,
    thickness: float,
    indices: tuple[float, float],
    away: float,
) -> None:
    """To 1e-6 px, rounding for a point 20 m away (largest seen: 2e-9)."""
    window = Window((*tilt, 1.0), distance, thickness, *indices)
    camera = replace(CAMERA, window=window)
    pixels = np.random.default_rng(0).uniform([300, 200], [980, 800], (20, 2))
    origins, directions = camera.rays_from(pixels)
    seen = camera.project(origins + away * directions)
    reached = np.isfinite(directions[:, 0])
    assert np.abs(seen - pixels)[reached].max(initial=0.0) < 1e-6


def test_snells_law_holds_at_both_faces() -> None:
    """Against the path of least time through the glass, by SciPy: Fermat's principle."""
    point, n = np.array([0.3, 0.1, 1.2]), np.array(TANK.normal)
    along = float(point @ n)
    height, off = along - TANK.distance_m - TANK.thickness_m, np.linalg.norm(point - along * n)

    def sideways(sine: float) -> float:
        parts = ((TANK.distance_m, 1.0), (TANK.thickness_m, TANK.glass), (height, TANK.medium))
        reached = (far * sine / np.sqrt(index**2 - sine**2) for far, index in parts)
        return float(sum(reached) - off)

    sine = brentq(sideways, 0.0, 1.0 - 1e-9, xtol=1e-15)
    direction = seen_through(TANK, point[None])[0]
    assert np.sqrt(1 - (direction @ n / np.linalg.norm(direction)) ** 2) == pytest.approx(
        sine, abs=1e-12
    )


def test_a_window_into_air_is_none() -> None:
    points = np.random.default_rng(1).uniform([-1, -1, 1], [1, 1, 4], (50, 3))
    none = Window((0.3, 0.2, 1.0), 0.1, 0.0, 1.52, 1.0)
    there = seen_through(none, points)
    assert np.abs(there / there[:, 2:] - points / points[:, 2:]).max() < 1e-13
    origins, directions = rays_through(none, points)
    away = points - origins
    assert np.abs(np.cross(away, directions)).max() < 1e-13


def test_no_point_before_the_window_has_an_image() -> None:
    n = np.array(TANK.normal)
    points = np.array([0.1 * n, 0.41 * n, 0.43 * n])  # in air, in the glass, in the water
    assert np.isfinite(CAMERA.project(points)[:, 0]).tolist() == [False, False, True]
    assert CAMERA.sees(points).tolist() == [False, False, True]


def test_another_camera_sees_the_same_plane() -> None:
    pose = Pose(Rotation.from_euler("y", 20.0, degrees=True).as_matrix(), np.array([-0.3, 0, 0.1]))
    there, n = moved_window(TANK, pose), np.array(TANK.normal)
    on_plane = TANK.distance_m * n + np.cross(n, np.random.default_rng(2).normal(size=(9, 3)))
    assert pose.apply(on_plane) @ there.normal == pytest.approx(there.distance_m, abs=1e-12)


def test_a_camera_is_kept_with_its_window() -> None:
    assert Camera.from_json(CAMERA.to_json(), "x").window == TANK
    assert "window" not in replace(CAMERA, window=None).to_json()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"normal": (0.0, 0.0, -1.0)}, "normal"),
        ({"distance_m": 0.0}, "distance"),
        ({"thickness_m": -0.01}, "thickness"),
        ({"medium": 0.9}, "index"),
        ({"glass": float("nan")}, "indices"),
    ],
)
def test_impossible_windows_are_refused(change: dict[str, object], word: str) -> None:
    with pytest.raises(StereocalError, match=word):
        replace(TANK, **change)  # type: ignore[arg-type]


def test_what_is_stated_from_a_camera_goes_with_it() -> None:
    stated = StatedWindow(("a", "b", "c"), 0.01, distance_m=0.5)
    of_two, of_others = (windows_of_some([stated], names)[0] for names in (["a", "c"], ["b", "c"]))
    assert (of_two.cameras, of_two.distance_m) == (("a", "c"), 0.5)
    assert (of_others.cameras, of_others.distance_m) == (("b", "c"), None)
    for wrong in (
        [replace(stated, cameras=("x",))],
        [stated, stated],
        [replace(stated, cameras=("b", "a"))],
    ):
        with pytest.raises(StereocalError, match=r"camera|window"):
            check_windows(wrong, ["a", "b", "c"])
