"""The compiled adjustment against finite differences, OpenCV and SciPy."""

from typing import Literal

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from stereocal.fit.least_squares import distortion, views
from stereocal.fit.least_squares.adjustment import add_baselines
from stereocal.fit.least_squares.distortion import lens_terms
from stereocal.fit.least_squares.small_steps import moved, rig_at, step_between
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.fit.least_squares.views import DISTORTION, DRIFT, EACH, OWN, TIME, Cameras
from stereocal.fit.refine import fit_from
from stereocal.rig.camera import CAMERAS, Camera
from stereocal.rig.rig import Rig
from stereocal.system.array_types import FloatArray
from tests.rig.machine_code import machine_code
from tests.rigs import known_rig as rig

fill_residuals, fill_shared = (machine_code(views.fill_residuals), machine_code(views.fill_shared))
distort = machine_code(distortion.distort)
set_distortion = machine_code(distortion.set_distortion)

STILL = np.empty((0, 2, 3))
LENSES = {
    "five": [-0.21, 0.17, 0.0009, -0.0013, -0.06],
    "eight": [0.11, -0.2, 0.001, -0.002, 0.03, 0.3, -0.1, 0.02],
    "twelve": [0.1, -0.2, 0.001, -0.002, 0.03, 0.3, -0.1, 0.02, 0.002, -0.003, 0.001, 0.004],
}
LENSES["tilted"] = [*LENSES["twelve"][:8], 0.002, -0.003, 0.001, 0.004, 0.03, -0.05]


def truth() -> Cameras:
    """The tests' rig, the second camera late."""
    at = rig_at(Rig(rig.PRIMARY, rig.SECONDARY, rig.RIG))
    at.q[EACH + TIME], at.q[EACH + DRIFT] = 0.3, 0.01
    return at


def frame_of(
    at: Cameras,
    x: FloatArray,
    pixels: FloatArray,
    motion: FloatArray = STILL,
    weights: tuple[float, float] = (4.0, 900.0),
) -> tuple[FloatArray, FloatArray]:
    """Residuals (9,) of one bar, and their derivatives (39, 9) by x and by the unknowns."""
    q, R, lenses, _ = at
    cameras = Cameras(q, R, set_distortion(q, DISTORTION, EACH, lenses))
    unit, work = views.Unit(pixels, motion, rig.BAR_M, *weights), views.work_of(2)
    s = fill_residuals(cameras, cameras.windows, unit, x, work)
    fill_shared(cameras, unit, x, True, work)
    r, Jx, Js, along, *_ = work
    by_x, by_q = np.zeros((OWN, 9)), np.zeros((len(q), 9))
    for end in range(2):
        by_x[3 * end : 3 * end + 3, 4 * end : 4 * end + 4] = Jx[end].reshape(4, 3).T
        for camera in range(2):
            own = 4 * end + 2 * camera
            by_q[EACH * camera : EACH * (camera + 1), own : own + 2] = Js[end, camera].T
    by_x[:, 8] = along[:OWN]
    by_q[-1, 8] = -(along[OWN] + weights[1] * rig.BAR_M) / q[-1]
    errors = np.append(r.ravel(), along[OWN])
    assert s == pytest.approx(float(errors @ errors), rel=1e-12)
    return errors, np.concatenate([by_x, by_q])


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


@pytest.mark.parametrize("seed", [2, 3])
def test_slopes_are_those_of_finite_differences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = moved(truth(), 1e-3 * rng.normal(size=len(truth().q)) * truth().q)
    x = rig.bar_ends(1, int(rng.integers(1000))).ravel()
    pixels = rng.uniform(300, 900, (2, 2, 2))
    motion = rng.uniform(-30, 30, (2, 2, 3)) if seed % 2 else STILL
    motion[:, 0] = 0.0
    _, J = frame_of(at, x, pixels, motion)
    both = np.concatenate([x, np.zeros_like(at.q)])
    size = np.concatenate([x, at.q])
    for i in range(len(both)):
        step = 1e-6 * max(abs(size[i]), 1.0)
        plus, minus = both.copy(), both.copy()
        plus[i] += step
        minus[i] -= step
        difference = (
            frame_of(moved(at, plus[OWN:]), plus[:OWN], pixels, motion)[0]
            - frame_of(moved(at, minus[OWN:]), minus[:OWN], pixels, motion)[0]
        ) / (2 * step)
        # Measured: 2e-7 of the largest slope of the row (rounding of the difference).
        np.testing.assert_allclose(J[i], difference, rtol=0, atol=3e-6 * np.abs(J[i]).max() + 1e-6)


def test_an_unseen_target_and_one_behind_a_camera() -> None:
    at, x = truth(), rig.bar_ends(1).ravel()
    pixels = np.full((2, 2, 2), 500.0)
    pixels[1] = np.nan
    _, J = frame_of(at, x, pixels, weights=(1.0, 0.0))
    assert J[:, :4].any()
    assert not J[:, 4:8].any()
    x[2] = -1.0
    unit = views.Unit(pixels, STILL, np.nan, 1.0, 0.0)
    assert fill_residuals(at, at.windows, unit, x, views.work_of(2)) == np.inf


def test_the_result_is_scipys_of_the_whole_problem() -> None:
    """The places are eliminated; SciPy keeps them: 5 frames, 13 + 30 unknowns."""
    data = rig.dataset(5, 0.3)
    lens = LensPrior(0.01, 10.0)
    priors = RefineSettings(
        dict.fromkeys(CAMERAS, lens), sigma_px=0.3, scatter_m=0.001, loss="squares"
    )
    solve = fit_from(data, rig.RIG, priors)
    begin, (measured, sigma_m) = solve.at, solve.baselines[0, 2:]
    assert solve.run()
    start_at = solve.begin._replace(q=begin.q)  # turns about the same axes
    unknowns = solve.unknowns
    k = len(unknowns.names)
    free = np.isfinite(unknowns.sigma)

    def whole(z: FloatArray) -> FloatArray:
        at = moved(start_at, unknowns.M @ z[:k])
        T = at.q[EACH + 3 : EACH + 6]
        found = [z[:k][free] / unknowns.sigma[free]]
        found.append(np.array([(np.linalg.norm(T) - measured) / sigma_m]))
        for f, x in enumerate(z[k:].reshape(-1, OWN)):
            found.append(frame_of(at, x, solve.seen.pixels[f], weights=(1 / 0.3, 1000.0))[0])
        return np.concatenate(found)

    start = np.concatenate([np.zeros(k), rig.bar_ends(5).ravel()])
    peer = least_squares(whole, start, x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    # Measured: the costs agree to 2e-10, the parameters to 1e-4 of their standard errors.
    assert solve.cost == pytest.approx(2 * peer.cost, rel=1e-7)
    slopes = np.asarray(peer.jac)
    covariance = np.linalg.inv(slopes.T @ slopes)[:k, :k]
    sigma = np.sqrt(np.diag(covariance))
    away = unknowns.M.T @ step_between(solve.at, moved(start_at, unknowns.M @ peer.x[:k]))
    assert (np.abs(away / np.square(unknowns.M).sum(axis=0)) < 1e-3 * sigma).all()
    A = unknowns.M.T @ solve.H @ unknowns.M + solve.at_end.precision
    # SciPy's slopes are finite differences.
    np.testing.assert_allclose(np.sqrt(np.diag(np.linalg.inv(A))), sigma, rtol=1e-3)


def test_left_out_frames_have_no_say() -> None:
    data = rig.dataset(10, 0.2)
    solve = fit_from(data, rig.RIG, RefineSettings())
    sides = []
    for limits in (np.where(np.arange(10) < 6, np.inf, 0.0), np.full(6, np.inf)):
        n = len(limits)
        points, chi_squares = np.full((n, OWN), np.nan), np.empty(n)
        sides.append(solve.sum_at(100.0, limits, points, chi_squares, np.arange(n)))
    for first, second in zip(*sides, strict=True):
        np.testing.assert_array_equal(first, second)


def test_the_baseline_s_derivatives_are_those_of_finite_differences() -> None:
    rng = np.random.default_rng(1)
    q, R = rng.normal(size=3 * EACH + 1), Rotation.random(3, random_state=1).as_matrix()
    q[:-1].reshape(3, EACH)[:, :3] = 0.0
    baselines = np.array([[0.0, 2.0, 1.5, 0.1], [2.0, 1.0, 0.7, 0.2]])

    def cost(turn: FloatArray, at: FloatArray) -> float:
        turned = Rotation.from_rotvec(turn).as_matrix() @ R
        return add_baselines(baselines, at, turned, np.zeros((len(q),) * 2), np.zeros(len(q)))

    H, g = np.zeros((len(q),) * 2), np.zeros(len(q))
    add_baselines(baselines, q, R, H, g)
    for c in range(3):
        for i in range(6):
            found = []
            for step in (1e-6, -1e-6):
                turn, at = np.zeros((3, 3)), q.copy()
                if i < 3:
                    turn[c, i] = step
                else:
                    at[EACH * c + i] += step
                found.append(cost(turn, at))
            # the gradient is half the derivative; measured: 1e-7
            assert g[EACH * c + i] == pytest.approx((found[0] - found[1]) / 4e-6, abs=1e-5)
    np.testing.assert_allclose(np.linalg.matrix_rank(H), 2)


@pytest.mark.parametrize(("loss", "is_followed"), [("robust", False), ("squares", True)])
def test_a_second_start_is_left_only_where_it_is_known_to_lead_to_the_first(
    loss: Literal["robust", "squares"], is_followed: bool
) -> None:
    """Plain least squares have fitted nothing when they begin: two starts are not alike then."""
    settings = RefineSettings(loss=loss)
    first, second = (fit_from(rig.dataset(20, 0.2), rig.RIG, settings) for _ in range(2))
    assert first.run()
    assert second.run([first]) == is_followed
