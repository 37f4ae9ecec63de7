"""The compiled adjustment against finite differences, OpenCV and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares

from stereocal.refined import adjustment, bar_fit, distortion
from stereocal.refined.adjustment import sum_normal_equations
from stereocal.refined.bar_fit import (
    ALL,
    BAR,
    BASELINE,
    DISTORTION,
    DRIFT,
    ERRORS,
    OWN,
    PRIMARY,
    RESIDUALS,
    SHARED,
    TIME,
)
from stereocal.refined.distortion import lens_terms
from stereocal.refined.solve import Solve, lenses_of
from stereocal.refined.unknowns import LensPrior, RefineSettings, unknowns_of
from stereocal.rig import decompositions
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.geometry import fill_pose
from tests import known_rig as rig
from tests.rig.machine_code import machine_code

backward, factor = machine_code(decompositions.backward), machine_code(decompositions.factor)
forward, loss = machine_code(decompositions.forward), machine_code(adjustment.loss)
fill_motions, fill_residuals = (
    machine_code(bar_fit.fill_motions),
    machine_code(bar_fit.fill_residuals),
)
fill_shared_derivatives = machine_code(bar_fit.fill_shared_derivatives)
distort = machine_code(distortion.distort)
set_distortion = machine_code(distortion.set_distortion)

LENSES = {
    "five": [-0.21, 0.17, 0.0009, -0.0013, -0.06],
    "eight": [0.11, -0.2, 0.001, -0.002, 0.03, 0.3, -0.1, 0.02],
    "twelve": [0.1, -0.2, 0.001, -0.002, 0.03, 0.3, -0.1, 0.02, 0.002, -0.003, 0.001, 0.004],
    "tilted": [
        0.1,
        -0.2,
        0.001,
        -0.002,
        0.03,
        0.3,
        -0.1,
        0.02,
        0.002,
        -0.003,
        0.001,
        0.004,
        0.03,
        -0.05,
    ],
}


def truth() -> FloatArray:
    """The 25 shared unknowns of the tests' rig."""
    q = np.empty(SHARED)
    q[:5], q[BASELINE], q[BAR] = rig.ANGLES, rig.BASELINE_M, 1.0
    lenses = [rig.PRIMARY.lens_values, rig.SECONDARY.lens_values]
    q[PRIMARY:TIME] = np.concatenate([lens[:4] for lens in lenses] + [lens[4:] for lens in lenses])
    q[TIME], q[DRIFT] = 0.3, 0.01
    return q


def frame_of(q: FloatArray, x: FloatArray, pixels: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Residuals and slopes of one frame."""
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q[:5], q[BASELINE], R, T)
    fill_motions(q, R, motions)
    slopes, J = np.empty((8, 5)), np.empty((ALL + 1, RESIDUALS))
    lenses = set_distortion(q, DISTORTION, lenses_of(rig.dataset(5)))
    s = fill_residuals(q, R, T, lenses, pixels, rig.BAR_M, 4.0, 900.0, x, slopes, J)
    fill_shared_derivatives(
        q, R, motions, lenses, True, pixels, rig.BAR_M, 4.0, 900.0, x, slopes, J
    )
    assert s == pytest.approx(float(J[ERRORS] @ J[ERRORS]), rel=1e-12)
    return J[ERRORS], J[:ALL]


def bending(camera: Camera) -> FloatArray:
    """The lens as `distort` reads it."""
    return np.array([[0.0, *lens_terms(camera)]])


@pytest.mark.parametrize("name", LENSES)
def test_bend_is_opencvs_model(name: str) -> None:
    camera = Camera(np.eye(3), np.array(LENSES[name]), (100, 100))
    points = np.random.default_rng(1).uniform(-0.5, 0.5, (50, 2))
    mine = np.array([distort(x, y, bending(camera), 0)[:2] for x, y in points])
    # OpenCV's projectPoints of the same model; measured: 1.1e-16.
    np.testing.assert_allclose(mine, camera.distort(points), rtol=0, atol=1e-13)


@given(seed=rig.SEEDS)
@settings(max_examples=6)
def test_slopes_are_those_of_finite_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    q = truth() * (1 + 1e-3 * rng.normal(size=SHARED))
    x = rig.bar_ends(1, int(rng.integers(1000))).ravel()
    pixels = rng.uniform(300, 900, (2, 4 if seed % 2 else 7))  # without and with its motion
    _, J = frame_of(q, x, pixels)
    both = np.concatenate([x, q])
    for i in range(ALL):
        step = 1e-6 * max(abs(both[i]), 1.0)
        plus, minus = both.copy(), both.copy()
        plus[i] += step
        minus[i] -= step
        difference = (
            frame_of(plus[OWN:], plus[:OWN], pixels)[0]
            - frame_of(minus[OWN:], minus[:OWN], pixels)[0]
        ) / (2 * step)
        # Measured: 2e-7 of the largest slope of the row (rounding of the difference).
        np.testing.assert_allclose(J[i], difference, rtol=0, atol=3e-6 * np.abs(J[i]).max() + 1e-6)


def test_an_unseen_target_and_one_behind_a_camera() -> None:
    q, x = truth(), rig.bar_ends(1).ravel()
    pixels = np.full((2, 4), 500.0)
    pixels[1] = np.nan
    R, T, motions = np.empty((3, 3)), np.empty(3), np.empty((6, 3))
    fill_pose(q[:5], q[BASELINE], R, T)
    fill_motions(q, R, motions)
    slopes, J = np.empty((8, 5)), np.empty((ALL + 1, RESIDUALS))
    lenses = lenses_of(rig.dataset(5))
    fill_residuals(q, R, T, lenses, pixels, np.nan, 1.0, 0.0, x, slopes, J)
    fill_shared_derivatives(q, R, motions, lenses, True, pixels, np.nan, 1.0, 0.0, x, slopes, J)
    assert J[:, :4].any()
    assert not J[:, 4:].any()
    x[2] = -1.0
    s = fill_residuals(q, R, T, lenses, pixels, np.nan, 1.0, 0.0, x, slopes, J)
    assert s == np.inf


@given(seed=rig.SEEDS, n=st.integers(1, 8))
@settings(max_examples=20)
def test_cholesky(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(n, n)) + 3 * np.eye(n)
    A, b = root @ root.T, rng.normal(size=n)
    L, x = A.copy(), b.copy()
    assert factor(L, 0.0)
    forward(L, x)
    backward(L, x)
    np.testing.assert_allclose(A @ x, b, atol=1e-8 * np.linalg.cond(A))
    A[0, 0] = -1.0
    assert not factor(A, 0.0)


def test_the_result_is_scipys_of_the_whole_problem() -> None:
    """The places are eliminated; SciPy keeps them: 15 frames, 13 + 90 unknowns."""
    data = rig.dataset(15, 0.3)
    priors = RefineSettings(
        primary=LensPrior(0.01, 10.0),
        secondary=LensPrior(0.01, 10.0),
        sigma_px=0.3,
        scatter_m=0.001,
        loss="squares",
    )
    solve = Solve(data, rig.RIG, priors)
    assert solve.run()
    unknowns, lenses = solve.unknowns, lenses_of(data)
    k = len(unknowns.names)
    free = np.isfinite(unknowns.sigma)

    def whole(z: FloatArray) -> FloatArray:
        q = unknowns.origin + unknowns.M @ z[:k]
        R, T = np.empty((3, 3)), np.empty(3)
        fill_pose(q[:5], q[BASELINE], R, T)
        found = [z[:k][free] / unknowns.sigma[free]]
        for f, x in enumerate(z[k:].reshape(-1, OWN)):
            slopes, J = np.empty((8, 5)), np.empty((ALL + 1, RESIDUALS))
            fill_residuals(
                q, R, T, lenses, solve.pixels[f], rig.BAR_M, 1 / 0.3, 1000.0, x, slopes, J
            )
            found.append(J[ERRORS])
        return np.concatenate(found)

    start = np.concatenate([np.zeros(k), rig.bar_ends(15).ravel()])
    peer = least_squares(whole, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # Measured: the costs agree to 2e-10, the parameters to 1e-4 of their standard errors.
    assert solve.cost == pytest.approx(2 * peer.cost, rel=1e-7)
    slopes = np.asarray(peer.jac)
    covariance = np.linalg.inv(slopes.T @ slopes)[:k, :k]
    sigma = np.sqrt(np.diag(covariance))
    assert (np.abs(peer.x[:k] - solve.p) < 1e-3 * sigma).all()
    A = unknowns.M.T @ solve.H @ unknowns.M + unknowns.precision
    # SciPy's slopes are finite differences.
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(A))), sigma, rtol=1e-3)


def test_left_out_frames_have_no_say() -> None:
    data = rig.dataset(10, 0.2)
    unknowns = unknowns_of(data, rig.RIG, RefineSettings())
    solve = Solve(data, rig.RIG, RefineSettings())
    sides = []
    for limits in (np.where(np.arange(10) < 6, np.inf, 0.0), np.full(6, np.inf)):
        n = len(limits)
        H, g = np.empty((SHARED, SHARED)), np.empty(SHARED)
        cost = sum_normal_equations(
            unknowns.origin,
            unknowns.free,
            solve.lenses,
            solve.pixels[:n],
            solve.rays[:n],
            solve.distances[:n],
            5.0,
            100.0,
            limits,
            np.full((n, OWN), np.nan),
            np.empty(n),
            H,
            g,
        )
        sides.append((cost, H, g))
    for first, second in zip(*sides, strict=True):
        np.testing.assert_array_equal(first, second)
