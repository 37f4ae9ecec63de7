"""Rigs of three cameras and more: truth, errors, and a pair as the smallest case."""

import os
from dataclasses import astuple, replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from stereocal.calibration.corrections import with_pixels
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.least_squares.small_steps import step_between
from stereocal.fit.least_squares.unknowns import FIXED_LENS, RefineSettings
from stereocal.fit.least_squares.views import EACH, TRANSLATION, fit_points
from stereocal.fit.parameter_file import of_file
from stereocal.fit.rig_calibration import RigCalibration, third_cameras
from stereocal.fit.rig_file import rig_file
from stereocal.fit.screening.movement import MovedError
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.fit.timing import out_of_step
from stereocal.formats.dataset_files import read_recording
from stereocal.library.calibrations import calibrate
from stereocal.rig.recording import Recording
from stereocal.simulation.rigs import SimulatedRig, simulated_rig
from stereocal.system.array_types import FloatArray
from tests.further import further
from tests.refused import refused
from tests.rigs.mistakes import in_images, joined, undistorted

SAMPLE = Path(__file__).parents[2] / "sample_data" / "rig"


def simulated(seed: int, cameras: int = 3) -> SimulatedRig:
    return simulated_rig(np.random.default_rng(seed), cameras, 120)


def pose_errors(rig: RigCalibration, truth: SimulatedRig) -> FloatArray:
    """(6 (c - 1),): errors of the poses over the stated ones."""
    found = []
    sigma = np.sqrt(np.diag(rig.covariance))
    for number, name in enumerate(rig.names[1:], 1):
        own, true = rig.poses[name], truth.poses[name]
        turn = Rotation.from_matrix(own.R @ true.R.T).as_rotvec()
        at = EACH * number
        found.append(np.concatenate([turn, own.T - true.T]) / sigma[at : at + 6])
    return np.concatenate(found)


@pytest.mark.parametrize("cameras", [3, *further(4)])
def test_errors_are_as_stated(cameras: int) -> None:
    # rms of errors over stated ones: 0.98 of 12 rigs of three, 0.90 of 8 rigs of four
    z = []
    for seed in range(3):
        truth = simulated(seed, cameras)
        rig = calibrate_rig(truth.recording, truth.settings)
        z.append(pose_errors(rig, truth))
        assert not rig.wrong
        assert not rig.unreached
    assert 0.7 < np.sqrt(np.mean(np.square(z))) < 1.3


@pytest.mark.parametrize("measured", [False, True])
def test_a_rig_of_two_cameras_is_the_refined_set_of_calibrate(measured: bool) -> None:
    truth = simulated(3, 3)
    recording = truth.recording.of_cameras(["c1", "c2"])
    if measured:
        baseline = float(np.linalg.norm(truth.poses["c2"].T))
        recording = replace(recording, baselines_m={("c1", "c2"): baseline}, baseline_sigma_m=0.005)
    points = recording.points.copy()
    points[::97] += 20.0
    recording = replace(recording, points=points)
    calibration = calibrate(with_baseline_found(recording.pair("c1", "c2")))
    pair, rig = calibration.refined, calibrate_rig(recording)
    assert pair is not None
    # Measured: 1e-8 of the standard errors with a baseline, 3e-7 without.
    away = step_between(rig.fit.at, pair.at) / np.sqrt(np.diag(pair.covariance)).clip(1e-12)
    assert np.abs(away).max() < 1e-5
    left_out = {*calibration.screening.left_out, *pair.outlying_frames}
    assert len(left_out) > 3 and {*rig.left_out} == left_out
    of_pair = rig_file(rig).pair("c1", "c2").uncertainties
    assert of_pair is not None
    sigmas = np.sqrt(np.diag(of_pair["covariance"]["matrix"]))
    # how frames that follow each other count is found from other residuals: 0.2 % here
    assert sigmas == pytest.approx(
        np.sqrt(np.diag(of_file(pair.covariance, pair.pose)))[: len(sigmas)], rel=0.01
    )


def test_measured_baselines_give_the_scale() -> None:
    truth = simulated(4)
    measured = {("c1", "c3"): float(np.linalg.norm(truth.poses["c3"].T))}
    recording = replace(truth.recording, baselines_m=measured, baseline_sigma_m=0.0002)
    loose = replace(truth.settings, distance_sigma_m=0.05 * recording.object.longest_m)
    rig, at = calibrate_rig(recording, loose), 2 * EACH + TRANSLATION
    assert rig.poses["c3"].baseline == pytest.approx(measured["c1", "c3"], abs=0.001)
    # without it, the object's length is known to 5 % only, and so is the scale
    free = calibrate_rig(truth.recording, loose)
    assert 0.09 * free.covariance[at, at] > rig.covariance[at, at]


@pytest.mark.parametrize("exchanged", [False, True])
def test_cameras_exchanged_in_the_measured_baselines_are_asked_about(exchanged: bool) -> None:
    truth = simulated(4)
    of = {"c2": "c3", "c3": "c2"} if exchanged else {}

    def apart(*pair: str) -> float:
        first, second = (truth.poses[of.get(name, name)] for name in pair)
        return (second @ first.inverse()).baseline

    measured = {pair: apart(*pair) for pair in [("c1", "c2"), ("c1", "c3"), ("c2", "c3")]}
    rig = calibrate_rig(replace(truth.recording, baselines_m=measured), truth.settings)
    asked = [note for note in rig.warnings if "c2 and c3 are exchanged" in note]
    assert len(asked) == exchanged


def test_a_wrong_image_is_named_with_its_camera() -> None:
    truth = simulated(5)
    rows = truth.recording
    frames, pixels = rows.images()
    whole = frames[np.isfinite(pixels[..., 0])[:, [0, 2]].all(axis=(1, 2))][:6].tolist()
    points = rows.points.copy()

    def at(frame: int, camera: int, target: int) -> int:
        mine = (rows.frame == frame) & (rows.camera == camera) & (rows.target == target)
        return int(np.flatnonzero(mine)[0])

    points[at(whole[0], 1, 2)] += [25.0, 20.0]
    one, other = at(whole[1], 2, 0), at(whole[1], 2, 2)
    points[[one, other]] = points[[other, one]]
    rig = calibrate_rig(replace(rows, points=points), truth.settings)
    named = {(own.frame, own.camera, own.target, own.exchanged) for own in rig.wrong}
    assert named == {(whole[0], "c2", "B", False), (whole[1], "c3", None, True)}
    assert not rig.left_out
    # the other images of these frames are still used
    assert {whole[0], whole[1]} <= {*rig.fit.frames.tolist()}


def test_a_chain_of_four_that_only_neighbours_see() -> None:
    truth = simulated_rig(np.random.default_rng(6), 4, 180, neighbours_only=True)
    rig = calibrate_rig(truth.recording, truth.settings)
    assert [*rig.pairs.fits] and not rig.unreached
    assert np.sqrt(np.mean(np.square(pose_errors(rig, truth)))) < 2.0


def test_a_camera_that_shares_nothing_is_named() -> None:
    truth = simulated(7, 4)
    rows = truth.recording
    apart = rows.camera == 3
    frame = np.where(apart, rows.frame + 10_000, rows.frame)
    rig = calibrate_rig(replace(rows, frame=frame), truth.settings)
    assert [*rig.unreached] == ["c4"]
    assert "c4" in rig.unreached["c4"]
    assert rig.names == ["c1", "c2", "c3"]


def test_points_of_another_recording_are_named() -> None:
    truth, other = simulated(8, 4), simulated(9, 4)
    rows, foreign = truth.recording, other.recording
    mixed = joined(rows.where(rows.camera != 2), foreign.where(foreign.camera == 2))
    rig = calibrate_rig(mixed, truth.settings)
    assert [*rig.unreached] == ["c3"]
    assert np.sqrt(np.mean(np.square(pose_errors(rig, truth)))) < 2.0


def test_no_pair_at_all() -> None:
    rows = simulated(10).recording
    frame = rows.frame + 1000 * rows.camera
    with refused("8 bars", "c1-c2 (0 frames)", "c2-c3 (0 frames)"):
        calibrate_rig(replace(rows, frame=frame))


def held_out(rig: RigCalibration, rows: Recording) -> tuple[float, dict[tuple[str, str], float]]:
    """The root mean square distance of images, in px, of frames that three cameras see, best
    98 %; and mean length errors, best 98 %, of pairs of targets."""
    _, pixels = rows.images()
    pixels = pixels[(np.isfinite(pixels[..., 0]).sum(axis=2) > 2).all(axis=1)]
    flat = pixels.reshape(-1, *pixels.shape[2:])
    rays = np.stack(
        [camera.undistort(flat[:, c]) for c, camera in enumerate(rig.cameras.values())], axis=1
    )
    points, residuals, *_ = fit_points(rig.fit.at, flat, rays)
    placed = points.reshape(*pixels.shape[:2], 3)
    names = rows.object.names
    lengths = {}
    for i, j in combinations(range(len(names)), 2):
        found = np.linalg.norm(placed[:, i] - placed[:, j], axis=1) / rows.object.distance(i, j) - 1
        lengths[names[i], names[j]] = float(best(np.abs(found)).mean())
    squares = np.square(residuals).sum(axis=2).mean(axis=1).reshape(pixels.shape[:2])
    return float(np.sqrt(best(squares[:, [0, -1]].ravel()).mean())), {
        **lengths,
        ("M", "px"): float(np.sqrt(best(squares[:, 1]).mean())),
    }


def best(values: FloatArray) -> FloatArray:
    return np.sort(values)[: int(0.98 * len(values))]


@pytest.fixture(scope="module")
def ewand() -> Recording:
    if "STEREOCAL_REAL_DATA" not in os.environ:
        pytest.skip("STEREOCAL_REAL_DATA names no folder of recordings")
    recording = read_recording(f"{os.environ['STEREOCAL_REAL_DATA']}/ewand123")
    return replace(recording, baselines_m={})


def test_a_real_recording_of_three_cameras(ewand: Recording) -> None:
    rig = calibrate_rig(ewand.where(ewand.frame % 2 == 0))
    px, lengths = held_out(rig, ewand.where(ewand.frame % 2 == 1))
    # 0.288 px and 0.098 %; a joint bundle adjustment in SciPy 0.288 px and 0.097 %
    assert px <= 0.30
    assert lengths["A", "B"] <= 0.0010
    (loop,) = rig.loops
    assert astuple(loop.before) == pytest.approx((0.37, 0.016), rel=0.1)
    # 12 of 280 frames by the limits of all trials together; by those of one trial 17
    assert len(rig.left_out) <= 14 and not rig.warnings
    # each pair of the rig against its own fit: 1.01 to 1.02
    thirds = third_cameras(rig)
    assert max(own.before for own in thirds) > 8
    assert max(own.after for own in thirds) < 0.6


def test_the_marker_between_need_not_be_used(ewand: Recording) -> None:
    ends = (ewand.frame % 2 == 0) & (ewand.target != 1)
    rig = calibrate_rig(ewand.where(ends))
    _, lengths = held_out(rig, ewand.where(ewand.frame % 2 == 1))
    # 0.33 px; 0.28 % of 0.13 m and 0.15 % of 0.26 m
    assert lengths["M", "px"] <= 0.36
    assert lengths["A", "M"] <= 0.0032
    assert lengths["M", "B"] <= 0.0016


def test_points_of_undistorted_images_are_no_movement(ewand: Recording) -> None:
    part = ewand.where(ewand.frame < np.unique(ewand.frame)[300])
    wrong = in_images(with_pixels(part, ["3"], undistorted))
    # they would fit to 0.33 px, parts of the recording in time do not fit
    with refused("camera 3", "undistorted", by=MovedError):
        calibrate_rig(wrong)


@pytest.mark.soak  # it would only take longer
def test_a_sound_rig_is_not_searched_for_time_offsets(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of one pair errors follow each other, but not the motion: -0.0005 ± 0.0009 frames. The search
    took as long as all else."""

    def searched(*_: Any) -> None:
        raise AssertionError

    monkeypatch.setattr(out_of_step, "first_value", searched)
    assert not calibrate_rig(read_recording(SAMPLE)).time_offsets.any()


def test_points_behind_a_third_camera_have_no_distance_from_its_images() -> None:
    truth = simulated(1)
    rig = calibrate_rig(truth.recording)
    assert third_cameras(rig)
    behind = np.random.default_rng(0).uniform(400.0, 600.0, (20, 3, 2))
    behind[:, 0, 0], behind[:, 1:, 0] = 0.0, 1279.0
    behind[:, 2, 0] = 640.0
    assert all(np.isfinite([own.before, own.after]).all() for own in third_cameras(rig, behind))


def test_what_is_stated_of_a_rig_is_checked_and_used() -> None:
    """A free distortion is one of its camera in the rig; a camera that there is not, and an
    impossible uncertainty, are refused at once."""
    truth = simulated(4)
    freed = replace(truth.settings, free_distortion=("c3",))
    rig = calibrate_rig(truth.recording, freed)
    assert not rig.unreached and len(rig.pairs.fits) == 3
    names = [name for name in rig.fit.unknowns.names if name.endswith(" k1")]
    assert names == ["c3 k1"]
    for settings, said in (
        (RefineSettings({"c9": FIXED_LENS}), ["lenses", "c9"]),
        (RefineSettings(free_distortion=("c9",)), ["free_distortion", "c9"]),
        (RefineSettings(distance_sigma_m=5.0), ["targets", " 5 m", "0.6 m"]),
    ):
        with refused(*said):
            calibrate_rig(truth.recording, settings)
    measured = replace(truth.recording, baselines_m={("c1", "c2"): 5.27})
    with refused("baseline", " 5 m", "5.27 m"):
        calibrate_rig(measured, RefineSettings(baseline_sigma_m=5.0))


def test_settings_of_named_cameras_round_trip() -> None:
    settings = RefineSettings({"left": FIXED_LENS}, free_distortion=("left",))
    assert RefineSettings.from_json(settings.to_json()) == settings
    with refused("sigma_pixel"):
        RefineSettings.from_json({"sigma_pixel": 0.2})
