"""The compiled costs against plain NumPy, which finds its points by another way."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stereocal.calibration import costs
from stereocal.rig.camera import pixel_scales
from stereocal.rig.geometry import Pose, triangulate_rays
from stereocal.system.array_types import FloatArray
from tests.calibration import reference
from tests.rig.machine_code import machine_code
from tests.rigs.known_rig import PRIMARY, RIG, SECONDARY, SEEDS, bar_ends, random_rig, rays_of

NOTHING = np.empty((0, 0))
reprojection_cost = machine_code(costs.reprojection_cost)
distance_cost, points_cost = machine_code(costs.distance_cost), machine_code(costs.points_cost)
SCALE = pixel_scales((PRIMARY, SECONDARY))


def noisy(seed: int, pairs: int) -> tuple[Pose, FloatArray, FloatArray] | None:
    """A rig with its points and noisy rays; None for rays so parallel that depths are noise."""
    pose, points = random_rig(seed, pairs)
    exact = rays_of(pose, points)
    p = np.vstack([exact[:2], np.ones(pairs)])
    q = pose.R.T @ np.vstack([exact[2:], np.ones(pairs)])
    sine = np.linalg.norm(np.cross(p.T, q.T), axis=1)
    if (sine < 0.02 * np.linalg.norm(p, axis=0) * np.linalg.norm(q, axis=0)).any():
        return None
    return pose, points, exact + np.random.default_rng(seed).normal(0, 1e-3, exact.shape)


# Both ways of finding the midpoint lose 1 / sine^2, here at most 2500, of 1e-16, on each of the
# points, and a distance is a small difference of them; measured over 150 rigs: 1.3e-11.
RELATIVE = 1e-9


@given(SEEDS, st.integers(1, 30))
@settings(max_examples=150)
def test_compiled_costs_equal_plain_numpy(seed: int, bars: int) -> None:
    made = noisy(seed, 2 * bars)
    if made is None:
        return
    pose, points, rays = made
    R, T = pose.R, pose.T
    np.testing.assert_allclose(
        reprojection_cost(R, T, rays, SCALE),
        reference.reprojection_cost(R, T, rays, SCALE),
        rtol=RELATIVE,
    )
    # A bar never as long as the points are apart, so that no cost is a difference near zero.
    lengths = 0.5 * np.linalg.norm(points[:bars] - points[bars:], axis=1)[None, :]
    np.testing.assert_allclose(
        distance_cost(R, T, rays, lengths),
        reference.distance_cost(R, T, rays, lengths),
        rtol=RELATIVE,
    )
    known = np.ascontiguousarray(points.T) + 0.1
    np.testing.assert_allclose(
        points_cost(R, T, rays, known), reference.points_cost(R, T, rays, known), rtol=RELATIVE
    )
    np.testing.assert_allclose(
        triangulate_rays(R, T, rays),
        reference.triangulate(R, T, rays),
        rtol=RELATIVE,
        atol=RELATIVE,
    )


def test_exact_points_cost_nothing() -> None:
    points = bar_ends(12)
    points = np.vstack([points[0::2], points[1::2]])
    rays = rays_of(RIG, points)
    R, T = RIG.R, RIG.T
    lengths = np.linalg.norm(points[:12] - points[12:], axis=1)[None, :]
    # Sums over 24 pairs of rounding: of 1000 px, and of 10 m.
    # Measured: 1.5e-11 px, 8e-14 m and 3e-13 m.
    assert reprojection_cost(R, T, rays, SCALE) < 1e-9
    assert distance_cost(R, T, rays, lengths) < 1e-11
    assert points_cost(R, T, rays, points.T.copy()) < 1e-11


@pytest.mark.parametrize("lost", [0, 5, 11])
def test_a_point_behind_a_camera_makes_every_cost_nan(lost: int) -> None:
    """NaN in any place, in both ends of the bars: never a number that the search might accept."""
    points = bar_ends(6)
    points[lost] *= -1.0
    rays, R, T = rays_of(RIG, points), RIG.R, RIG.T
    for kind, held in (
        (costs.REPROJECTION, NOTHING),
        (costs.DISTANCE, np.full((1, 6), 0.8)),
        (costs.POINTS, points.T.copy()),
    ):
        assert np.isnan(costs.cost(kind, R, T, rays, held, SCALE))
    assert np.isnan(reference.reprojection_cost(R, T, rays, SCALE))
