"""Method 1 against truth and against SciPy's least squares."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from scipy.optimize import least_squares

from stereocal.calibration import costs
from stereocal.calibration.essential import (
    Solver,
    _residual_coefficients,
    calibrate_essential,
    choose_pose,
    constrain,
    essential_slopes,
    linear_essential,
)
from stereocal.calibration.montecarlo import Problem
from stereocal.errors import StereocalError
from stereocal.rig.geometry import Angles, Pose, angles_of, residuals
from stereocal.system.array_types import FloatArray
from tests.refused import refused
from tests.rigs.known_rig import (
    ANGLES,
    ANY_ANGLES,
    BASELINE_M,
    RIG,
    SEEDS,
    bar_ends,
    dataset,
    rays_of,
)

NOISY = dataset(20, noise_px=0.4).rays
SOLVERS: tuple[Solver, ...] = ("linear", "constrained")


def residuals_at(angles: FloatArray, rays: FloatArray) -> FloatArray:
    E = Pose.from_angles(Angles(*angles), 1.0).essential
    return residuals(E, rays[:2].T, rays[2:].T)


def differences(angles: FloatArray, rays: FloatArray) -> FloatArray:
    """The Jacobian of the residuals by central differences, (n, 5)."""
    steps = 1e-6 * np.eye(5)
    return np.column_stack(
        [
            (residuals_at(angles + step, rays) - residuals_at(angles - step, rays)) / 2e-6
            for step in steps
        ]
    )


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("pairs", [5, 6, 7, 8, 50])
def test_exact_points_give_the_rig(pairs: int, solver: Solver) -> None:
    points = bar_ends(25)[:pairs]
    rays = rays_of(RIG, points)
    # Five pairs fit several rigs; known points say which is meant.
    known = Problem(costs.POINTS, rays, points.T.copy(), np.ones((2, 3)))
    found = calibrate_essential(rays, BASELINE_M, solver, tie_breaker=known.cost)
    # Rounding of 1e-16, times a few for the narrow field; measured: 1e-14, and costs of 2e-29.
    np.testing.assert_allclose(found.pose.angles, ANGLES, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.pose.R, RIG.R, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.pose.T, RIG.T, rtol=0, atol=1e-9 * BASELINE_M)
    assert found.cost < 1e-20


@pytest.mark.parametrize("seed", range(4))
def test_five_pairs_without_a_tie_breaker_still_fit_exactly(seed: int) -> None:
    rays = rays_of(RIG, bar_ends(3, seed)[:5])
    assert calibrate_essential(rays, BASELINE_M).cost < 1e-20


@pytest.mark.parametrize("baseline", [0.2, 2.37, 40.0])
def test_the_scale_is_the_measured_baseline(baseline: float) -> None:
    found = calibrate_essential(NOISY, baseline)
    assert found.pose.baseline == pytest.approx(baseline, rel=1e-13)
    direction = calibrate_essential(NOISY, 1.0).pose.T
    np.testing.assert_allclose(found.pose.T / baseline, direction, rtol=0, atol=1e-13)


class TestConstrained:
    def test_is_the_minimum_that_scipy_finds_from_the_same_start(self) -> None:
        R, t, _ = choose_pose(linear_essential(NOISY), NOISY)
        start = np.array(angles_of(R, t))
        peer = least_squares(
            residuals_at, start, args=(NOISY,), method="lm", xtol=1e-15, ftol=1e-15
        )
        found = calibrate_essential(NOISY, BASELINE_M)
        # SciPy stops 2e-7 rad away; the cost differs by the square of it; measured: 1e-11.
        assert found.cost == pytest.approx(2 * peer.cost, rel=1e-9)
        np.testing.assert_allclose(found.pose.angles, peer.x, rtol=0, atol=1e-6)
        assert found.stop_reason == "converged"

    @given(ANY_ANGLES, SEEDS)
    @settings(max_examples=60)
    def test_derivatives_are_those_of_finite_differences(self, angles: Angles, seed: int) -> None:
        rays = np.random.default_rng(seed).uniform(-0.5, 0.5, (4, 9))
        at = np.array(angles)
        J = (essential_slopes(at).T @ _residual_coefficients(rays)).T
        # Central differences of numbers of order 1: rounding 1e-16 / 1e-6, and 1e-12 of curvature;
        # measured: 3e-10.
        np.testing.assert_allclose(J, differences(at, rays), rtol=0, atol=1e-9)

    def test_finds_the_rig_from_a_degree_off(self) -> None:
        start = np.array(ANGLES) + 0.02
        angles, evaluations, converged = constrain(start, rays_of(RIG, bar_ends(10)))
        assert converged
        assert evaluations < 50
        # Exact points have an exact minimum; measured: 2e-16.
        np.testing.assert_allclose(angles, ANGLES, rtol=0, atol=1e-9)


class TestLinear:
    def test_opencv_recovers_the_same_pose_from_it(self) -> None:
        E = linear_essential(NOISY)
        p, q = NOISY[:2].T.copy(), NOISY[2:].T.copy()
        _, R, t, _ = cv2.recoverPose(E, p, q, np.eye(3))
        ours = choose_pose(E, NOISY)
        # The same decomposition of one matrix; measured: 4e-16.
        np.testing.assert_allclose(ours[0], np.asarray(R), rtol=0, atol=1e-12)
        np.testing.assert_allclose(ours[1], np.ravel(np.asarray(t)), rtol=0, atol=1e-12)
        assert ours[2] == NOISY.shape[1]


class TestRefusals:
    @pytest.mark.parametrize("pairs", [0, 1, 4])
    def test_fewer_than_five_pairs(self, pairs: int) -> None:
        with refused(f" {pairs} pair", "at least 5"):
            calibrate_essential(NOISY[:, :pairs], BASELINE_M)

    @pytest.mark.parametrize("pairs", [5, 7, 8, 30])
    def test_all_points_in_one_place(self, pairs: int) -> None:
        rays = np.repeat(rays_of(RIG, bar_ends(1)[:1]), pairs, axis=1)
        with pytest.raises(StereocalError):
            calibrate_essential(rays, BASELINE_M)

    def test_points_in_one_plane(self) -> None:
        """A wall fits a family of essential matrices."""
        flat = np.random.default_rng(0).uniform(-1, 1, (30, 2))
        wall = np.column_stack([flat, 8.0 + 0.3 * flat[:, 0] - 0.2 * flat[:, 1]])
        with refused("pose of the cameras", "degenerate"):
            calibrate_essential(rays_of(RIG, wall), BASELINE_M)

    def test_cameras_in_one_place(self) -> None:
        """Without a baseline both cameras see a turned picture, at any depth."""
        turned = Pose(RIG.R, np.zeros(3))
        with refused("pose of the cameras", "degenerate"):
            calibrate_essential(rays_of(turned, bar_ends(10)), BASELINE_M)
