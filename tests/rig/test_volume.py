"""The volume of the bars: its margin, what lies in it, there and back, and what is refused."""

import numpy as np
import pytest

from stereocal.rig.volume import Volume
from tests.refused import refused
from tests.rigs.known_rig import bar_ends

VOLUME = Volume((-0.3, 0.2), (-0.1, 0.25), (3.0, 8.0))
DIRECTIONS = np.linspace(-0.5, 0.5, 21) + 0.001


def test_every_end_of_the_bars_is_inside() -> None:
    points = bar_ends(25)
    assert Volume.of_bars(points).contains(points).all()
    assert Volume.of_bars(points.reshape(25, 2, 3)) == Volume.of_bars(points)


def test_a_point_is_inside_where_all_three_ranges_hold_it() -> None:
    depths = np.array([2.99, 3.0, 5.0, 8.0, 8.01])
    x, y, z = (each.ravel() for each in np.meshgrid(DIRECTIONS, DIRECTIONS, depths))
    inside = (x > -0.3) & (x < 0.2) & (y > -0.1) & (y < 0.25) & (z >= 3) & (z <= 8)
    found = VOLUME.contains(np.column_stack([x * z, y * z, z]))
    np.testing.assert_array_equal(found, inside)


def test_points_behind_the_camera_and_missing_ones_are_outside() -> None:
    """A point behind the camera has the direction of one before it."""
    points = np.array([[0.1, 0.1, 5.0], [-0.1, -0.1, -5.0], [0.0, 0.0, 0.0], [0.1, np.nan, 5.0]])
    wide = Volume((-0.3, 0.2), (-0.1, 0.25), (-8.0, 8.0))
    for volume in (VOLUME, wide):
        assert volume.contains(points).tolist() == [True, False, False, False]
    assert VOLUME.contains(np.full((2, 3), np.nan)).tolist() == [False, False]
    assert VOLUME.contains(np.empty((0, 3))).shape == (0,)


def test_the_margin_makes_up_for_the_shortness_of_a_range() -> None:
    """Of bars spread evenly over a depth of 4 to 9 m, the range with its margin is 5 m on
    average; the ends of each bar are at one place here."""
    rng = np.random.default_rng(0)
    plain, found = [], []
    for _ in range(2000):
        z = np.repeat(rng.uniform(4.0, 9.0, 10), 2)
        volume = Volume.of_bars(np.column_stack([0.1 * z, 0.2 * z, z]))
        plain.append(np.ptp(z))
        found.append(volume.z_m)
    assert np.mean(plain) == pytest.approx(5 * 9 / 11, abs=0.05)  # 2 / 11 short
    # The standard error of the means is 0.01 m.
    np.testing.assert_allclose(np.mean(found, axis=0), [4.0, 9.0], atol=0.05)


def test_bars_behind_the_camera_or_missing_do_not_count() -> None:
    points = bar_ends(10)
    more = np.vstack([points, -points, np.full((4, 3), np.nan)])
    assert Volume.of_bars(more) == Volume.of_bars(points)
    for none in (-points, np.empty((0, 3)), np.full((2, 3), np.nan)):
        with refused("bar ", "volume"):
            Volume.of_bars(none)
