"""Forecasts of the files against a truth that is known."""

from collections import defaultdict
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import binom

from stereocal.calibration.methods import Method
from stereocal.evaluation.evaluate import count_set
from stereocal.evaluation.summary import figures_of_set
from stereocal.fit.least_squares.small_steps import baseline_direction
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.refine import refine
from stereocal.library.calibrations import calibrate
from stereocal.matching.reconstruction import midpoints, noise_of_file
from stereocal.rig.camera import Camera, LensUncertainty
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.rig.volume import Volume
from stereocal.simulation.simulate import Scene, observe, place_bars
from stereocal.system.array_types import FloatArray
from stereocal.verdict.forecast import Forecast, forecast_files
from stereocal.verdict.forecast_draws import draw_forecast
from stereocal.verdict.fresh_frames import _facing, _stand_by_rays, fresh_bars, noise_given
from stereocal.verdict.intervals import mean_of, share_interval
from stereocal.verdict.judging import add_noise
from stereocal.workflow.answer import PairAnswer
from stereocal.workflow.pair_run import PairRun
from tests.further import of_a_whole_soak
from tests.refused import refused
from tests.rigs import known_rig as rig
from tests.rigs.fisheye_rig import recording
from tests.rigs.population import CASES, one_rig, population
from tests.rigs.refined_rigs import BAR_M, DEPTHS_M, Misjudged, random_scene, stated
from tests.soak import repeats

FIGURES = ("fcp_reprojection", "mean_reprojection_px", "median_error_3d", "p95_error_3d")


@lru_cache(maxsize=1)
def forecast() -> Forecast:
    return forecast_files(calibrate(rig.dataset(25, 0.2), refined=RefineSettings()))


@pytest.mark.soak
def test_the_intervals_hold_the_population() -> None:
    """8 rigs with misjudged lenses; 85 to 100 % of each figure held on many (docs/trust.md)."""
    held = dict.fromkeys(FIGURES, 0)
    for seed in range(8):
        for method, figures in one_rig(CASES["0.2 %, 4 px, baseline 0.5 %"], 25, seed).items():
            if method == "refined":
                for figure in FIGURES:
                    true, _, low, high = figures[figure]
                    held[figure] += low <= true <= high
    # At 85 %, fewer than 4 of 8 have a probability of 1 in 350.
    assert binom.cdf(3, 8, 0.85) < 5e-3
    assert min(held.values()) >= 4, held


def test_lenses_that_image_nothing_within_their_errors_have_no_forecast() -> None:
    """Before fisheyes, 2 % of the draws were seen, and the verdict was "nan times"."""
    calibration = calibrate(rig.dataset(25, 0.2), refined=RefineSettings())
    comparison = calibration.comparison
    assert comparison is not None
    model = comparison.model
    unknown = replace(model.unknowns, precision=1e-9 * model.unknowns.precision)
    vague = replace(model, information=1e-9 * model.information, unknowns=unknown)
    vars(calibration)["comparison"] = replace(comparison, model=vague)
    with refused("lenses", "standard errors"):
        forecast_files(calibration)


def test_same_seed_same_figures_whatever_the_workers() -> None:
    found = forecast()
    model = found.model
    one, two = (
        draw_forecast(model, found.files, seed=5, draws=20, bars=50, workers=n).figures
        for n in (1, 2)
    )
    assert one == two
    other = draw_forecast(model, found.files, seed=6, draws=20, bars=50).figures
    assert other != one


def test_the_shares_are_those_at_the_threshold() -> None:
    draws = forecast().draws
    loose, tight = (draws.figures_of("2d", px) for px in (5.0, 0.05))
    assert loose.correct_lost_at_threshold.value < tight.correct_lost_at_threshold.value
    assert loose.wrong_let_in_at_threshold.value > tight.wrong_let_in_at_threshold.value
    assert loose.threshold_px == tight.threshold_px
    # None of 102,400 lost does not prove that none is.
    assert loose.correct_lost_at_threshold.value == 0
    assert loose.correct_lost_at_threshold.high > 0


def test_the_population_is_that_of_a_plain_count() -> None:
    """The judgement of files against `count_set`, the count of the validation."""
    rng = np.random.default_rng(3)
    scene = place_bars(Rig(rig.PRIMARY, rig.SECONDARY, rig.RIG), rng, 400, BAR_M, DEPTHS_M)
    files = forecast().files
    true = population(scene.rig, files, scene.ends_m, 0.2, dict.fromkeys(files, 1.0), rng)
    data = observe(scene, rng, 0.2, "test")
    fcp, median = figures_of_set(count_set(data, files["2d"].pose))
    # Other noise, and wrong pairs from all frames instead of groups of 5: 1.6 % and 3 % measured.
    assert true["2d"]["median_error_3d"] == pytest.approx(median, rel=0.2)
    assert true["2d"]["fcp_reprojection"] == pytest.approx(fcp, rel=0.4)


def test_fresh_bars_are_in_the_volume_and_have_the_length() -> None:
    model = forecast().model
    ends = fresh_bars(model, 8, 200, np.random.default_rng(1))
    assert ends.shape == (8, 200, 2, 3)
    volume = Volume.of_bars(model.points_m)
    assert volume.contains(ends.reshape(-1, 3)).all()
    lengths = np.linalg.norm(ends[:, :, 0] - ends[:, :, 1], axis=2)
    np.testing.assert_allclose(lengths, rig.BAR_M, rtol=0.02)  # those adjusted to the images


def test_fresh_bars_of_fisheyes_are_as_far_away_as_recorded_ones() -> None:
    """On the plane z = 1 most places of a view of 150 degrees are at its rim, and far away."""
    dataset, _ = recording(150.0, 1, exact=True)
    model = refine(dataset, RefineSettings())
    ends = fresh_bars(model, 8, 200, np.random.default_rng(1)).reshape(-1, 3)
    known = model.used_points_m
    recorded = known[np.isfinite(known).all(axis=(1, 2))].reshape(-1, 3)
    found, expected = (
        np.percentile(np.linalg.norm(points, axis=1), (2, 50, 98)) for points in (ends, recorded)
    )
    # Measured: 1.37, 3.19 and 5.36 m for 1.35, 3.19 and 5.34; with places on the plane 6.94 m.
    assert_allclose(found, expected, rtol=0.1)
    away = np.arctan2(np.hypot(ends[:, 0], ends[:, 1]), ends[:, 2])
    assert away.max() < np.radians(75.0)


def test_whether_bars_stand_by_the_rays_of_a_fisheye_or_in_space() -> None:
    rng = np.random.default_rng(3)
    places = np.column_stack([rng.uniform(-1.0, 1.0, (60, 2)), np.ones(60)])
    upright = np.tile([0.0, 1.0, 0.0], (60, 1)) + 0.1 * rng.normal(size=(60, 3))
    across = np.column_stack([rng.normal(size=(60, 2)), np.zeros(60)])
    boards = np.einsum("nij,nj->ni", _facing(places), across)
    unit = [own / np.linalg.norm(own, axis=1)[:, None] for own in (upright, boards)]
    assert not _stand_by_rays(places, unit[0])
    assert _stand_by_rays(places, unit[1])


def test_draws_without_points_are_not_counted() -> None:
    """Nor are halves of draws, without a warning: where few frames see all, one may have none."""
    cases, of = np.array([[1, 2], [0, 0], [2, 1]]), np.array([[50, 50], [0, 0], [50, 50]])
    assert share_interval(cases, of) == share_interval(cases[[0, 2]], of[[0, 2]])
    assert np.isnan(share_interval(cases[[1]], of[[1]]).value)
    assert np.isnan(mean_of(np.full((2, 3), np.nan))).all()
    cases, of = np.tile([3, 4], (50, 1)), np.tile([100, 110], (50, 1))
    cases[0], of[0] = (3, 0), (100, 0)
    found = share_interval(cases, of)
    assert 0.0 <= found.low <= found.value <= found.high < 0.1


def test_bars_along_one_axis_stay_so() -> None:
    rng = np.random.default_rng(2)
    scene = place_bars(Rig(rig.PRIMARY, rig.SECONDARY, rig.RIG), rng, 40, BAR_M, DEPTHS_M, 300.0)
    middle = scene.ends_m.mean(axis=1)
    upright = np.array([0.0, 0.5 * BAR_M, 0.0])
    ends = np.stack([middle + upright, middle - upright], axis=1)
    data = observe(Scene(scene.rig, ends), rng, 0.1, "upright")
    model = refine(data)
    fresh = fresh_bars(model, 4, 100, rng)
    along = fresh[:, :, 0] - fresh[:, :, 1]
    assert (np.abs(along[..., 1]) > 0.95 * np.linalg.norm(along, axis=-1)).all()


def test_tails_of_the_noise_are_found() -> None:
    rng = np.random.default_rng(4)
    normal, heavy, lengths = rng.normal(size=400), rng.standard_t(3, size=400), rng.normal(size=200)
    sigmas = np.ones((1, 200))
    found = noise_given(normal, 5.0, lengths, sigmas, 2.0, 400, rng)
    assert np.median(found.across) == pytest.approx(1.0, abs=0.1)
    assert np.mean(found.degrees >= 15) > 0.8  # measured: 0.97
    found = noise_given(heavy, 5.0, lengths, sigmas, 2.0, 400, rng)
    assert np.mean(found.degrees <= 5) > 0.9  # measured: 1.0


def test_lengths_that_vary_more_are_the_bars_or_the_noises() -> None:
    """By which of both makes those vary most that are least certain. Measured: 1.00 and 2.77."""
    rng = np.random.default_rng(8)
    pixels, unit = rng.normal(size=400), np.geomspace(1e-4, 4e-3, 200)
    bends = 2e-3 * rng.normal(size=200)
    sigmas = np.array([np.hypot(unit, 2e-3), unit])
    for errors, along in (
        (unit * rng.normal(size=200) + bends, 1.0),
        (3 * unit * bends / 2e-3, 3.0),
    ):
        found = noise_given(pixels, 5.0, errors, sigmas, 2.0, 400, rng)
        assert np.median(found.along) == pytest.approx(along, rel=0.2)


def test_only_noise_across_the_lines_moves_a_pair_off_them() -> None:
    """The derivative of the residual is found by its definition, by central differences."""
    fitted, points = forecast().refined, rig.bar_ends(3)
    pixels, rays = np.zeros((6, 4)), np.ones((6, 2, 3))
    noise = np.random.default_rng(4).standard_normal((6, 4))
    start = add_noise(fitted.rig, points, 2.5, noise, pixels)
    rays[:, 0, :2], rays[:, 1, :2] = start[:2].T, start[2:].T
    two = fitted.pose.apply(points)
    assert_allclose(rays, np.stack([points / points[:, 2:], two / two[:, 2:]], axis=1), rtol=1e-12)
    focal = np.array([[c.K[0, 0], c.K[1, 1]] for c in (fitted.primary, fitted.secondary)])

    def off_the_line(moves_px: FloatArray) -> FloatArray:
        moved = rays.copy()
        moved[:, :, :2] += moves_px.reshape(6, 2, 2) / focal
        E = fitted.pose.essential
        return np.asarray(np.einsum("ni,ij,nj->n", moved[:, 1], E, moved[:, 0]))

    step = 1e-3 * np.eye(4)
    gradient = np.stack(
        [off_the_line(np.tile(s, (6, 1))) - off_the_line(np.tile(-s, (6, 1))) for s in step], axis=1
    )
    unit = gradient / np.linalg.norm(gradient, axis=1)[:, None]
    along = noise - np.sum(noise * unit, axis=1)[:, None] * unit
    assert_allclose(pixels, noise + 1.5 * along, atol=1e-8)  # measured: 3e-11


@of_a_whole_soak
@pytest.mark.parametrize("k1", [0.004, 0.0])
def test_sigmas_of_points_are_honest(k1: float, rigs: int = repeats(30, 60)) -> None:
    """z of points of rigs with unlike lens errors, stated; also of k1.

    Points of a rig share its errors, so that the rms of n rigs scatters by about 0.6 / sqrt(n).
    """
    squares = defaultdict[Method, list[float]](list)
    for seed in range(rigs):
        rng = np.random.default_rng([seed, 9])
        scene = random_scene(rng, 25)
        data = with_k1(stated(scene, rng, Misjudged()), k1, rng)
        settings = RefineSettings(baseline_sigma_m=0.005, distance_sigma_m=0.0005)
        files = PairAnswer(PairRun.of(calibrate(data, refined=settings))).sets
        test = place_bars(scene.rig, rng, 50, BAR_M, DEPTHS_M)
        seen = observe(test, rng, 0.2, "test").correspondences
        for method, file in files.items():
            pixels = np.stack([seen.primary, seen.secondary], axis=1)
            found = midpoints(file, pixels, noise_of_file(file)[0]).in_frame(None, None, True)
            assert found.sigma_m is not None
            z = (found.xyz - test.points_m[0]) / found.sigma_m
            squares[method].append(float(np.nanmean(np.square(z))))
    for method, found_squares in squares.items():
        rms = float(np.sqrt(np.mean(found_squares)))
        print(method, k1, rms)
        assert 0.85 < rms < 1.2, (method, rms)


def with_k1(data: Pair, sigma: float, rng: np.random.Generator) -> Pair:
    """The data set with lens files that state their errors, k1 of the primary off by `sigma`."""
    cameras = []
    for camera, own in ((data.primary, sigma), (data.secondary, 0.0)):
        errors = own * np.eye(camera.distortion.size)[0]
        off = camera.distortion + errors * rng.normal() if own else camera.distortion
        focal = 0.003 * camera.K[0, 0]
        known = LensUncertainty(focal, focal, 5.0, 5.0, errors)
        cameras.append(Camera(camera.K, off, camera.image_size, known))
    return data.changed(primary=cameras[0], secondary=cameras[1])


def test_the_covariance_of_a_file_contains_its_distance_from_the_model() -> None:
    found = forecast()
    T, along = found.model.pose.T, baseline_direction(found.model.at)
    away = (found.files["3d"].pose.T - T) @ T / found.model.pose.baseline
    expected = along @ found.model.covariance @ along + away**2
    assert along @ found.covariance("3d") @ along == pytest.approx(expected)
