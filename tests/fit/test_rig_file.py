"""rig.json, and the files of its pairs."""

import json
from dataclasses import replace

import numpy as np
import pytest

from stereocal.figures.rig_report import camera_table
from stereocal.fit.calibrate import calibrate_rig
from stereocal.fit.in_words import rig_sentence
from stereocal.fit.least_squares.unknowns import LensPrior, RefineSettings
from stereocal.fit.parameter_file import of_file
from stereocal.fit.refine import refine
from stereocal.fit.rig_calibration import RigCalibration
from stereocal.fit.rig_file import RigFile, rig_file
from stereocal.fit.start.baseline import with_baseline_found
from stereocal.rig.camera import CAMERAS
from stereocal.simulation.rigs import LENS_ERRORS, SimulatedRig, simulated_rig
from tests.refused import refused

STATED = LensPrior(*LENS_ERRORS)
PAIR_SETTINGS = RefineSettings(dict.fromkeys(CAMERAS, STATED))


@pytest.fixture(scope="module")
def truth() -> SimulatedRig:
    return simulated_rig(np.random.default_rng(20), 3, 150)


@pytest.fixture(scope="module")
def rig(truth: SimulatedRig) -> RigCalibration:
    return calibrate_rig(truth.recording, truth.settings)


def test_the_file_reads_back(rig: RigCalibration) -> None:
    written = rig_file(rig)
    read = RigFile.loads(written.dumps())
    assert read.names == ["c1", "c2", "c3"]
    for name in read.names:
        assert np.array_equal(read.poses[name].R, rig.poses[name].R)
        assert np.array_equal(read.cameras[name].K, rig.cameras[name].K)
    assert np.array_equal(read.covariance, rig.covariance)
    assert rig_sentence(read) == rig_sentence(written)
    assert read.to_json() | {"created": 0} == written.to_json() | {"created": 0}


def test_a_length_in_metres_has_the_error_of_the_object(truth: SimulatedRig) -> None:
    """Known to 0.1 % if nothing is stated, 0.5 % if it is: 1.96 of that and the scatter."""
    told = []
    for sigma in (None, 0.005):
        bare = replace(truth.recording, object=replace(truth.recording.object, sigma_m=None))
        sigma_m = None if sigma is None else sigma * bare.object.longest_m
        settings = replace(truth.settings, distance_sigma_m=sigma_m)
        file = rig_file(calibrate_rig(bare, settings))
        figures = file.about.figures
        assert figures is not None and figures.metric_error_p95 is not None
        scatter = figures.to_expect.length_error_p95
        assert scatter is not None
        own = figures.metric_error_p95**2 - scatter**2
        # Nothing else has the scale: no baseline is stated.
        assert np.sqrt(own) == pytest.approx(1.96 * (sigma or 0.001), rel=0.02)
        told.append(rig_sentence(RigFile.loads(file.dumps())))
    assert "most of it scatter" in told[0]
    assert "most of it from the" in told[1] and "± 0.5 %" in told[1]


def test_a_camera_without_points_that_two_others_see_is_in_the_table(rig: RigCalibration) -> None:
    file = rig_file(rig)
    unknown = dict.fromkeys(rig.names[:1])
    file = replace(file, about=replace(file.about, image_errors_px=unknown))
    assert camera_table(file)["image error, px"].tolist() == ["unknown"] * 3


def test_damaged_files_are_refused(rig: RigCalibration) -> None:
    content = rig_file(rig).to_json()
    for change, said in (
        ({"format": "other"}, "'other'"),
        ({"covariance": [[1.0]]}, "covariance"),
        ({"noise_px": "x"}, "'x'"),
        ({"cameras": {"c1": content["cameras"]["c1"]}}, "covariance"),
    ):
        with refused("rig.json: ", said):
            RigFile.loads(json.dumps({**content, **change}), "rig.json")
    with refused("rig.json: ", "'../c1'"):
        RigFile.loads(json.dumps(content).replace('"c1"', '"../c1"'), "rig.json")


def test_a_pair_of_the_rig_is_nearer_to_the_truth_than_by_itself(
    truth: SimulatedRig, rig: RigCalibration
) -> None:
    pair = ("c2", "c3")
    own = rig_file(rig).pair(*pair)
    true = truth.poses["c3"] @ truth.poses["c2"].inverse()
    assert own.camera_names == pair
    assert own.uncertainties is not None
    sigma = np.sqrt(np.diag(own.uncertainties["covariance"]["matrix"]))[:6]
    error = np.array([*own.pose.angles, own.pose.baseline])
    error -= np.array([*true.angles, true.baseline])
    assert np.sqrt(np.mean(np.square(error / sigma))) < 2.0
    alone = refine(with_baseline_found(truth.recording.pair(*pair)), PAIR_SETTINGS)
    assert (sigma < np.sqrt(np.diag(of_file(alone.covariance, alone.pose)))[:6]).all()
