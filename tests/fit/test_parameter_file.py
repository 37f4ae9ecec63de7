"""The third parameter file: its own lenses, its uncertainties, there and back."""

import numpy as np
import pytest

from stereocal.fit.errors.disagreement import compare_inputs
from stereocal.fit.least_squares.unknowns import RefineSettings
from stereocal.fit.parameter_file import COVARIANCE_OF, errors_of_set, refined_parameters
from stereocal.fit.refine import refine
from stereocal.fit.refined_result import RefinedResult
from stereocal.library.calibrations import calibrate
from stereocal.rig.parameters import RigParameters
from tests.rigs import known_rig as rig
from tests.rigs.refined_rigs import Misjudged, random_scene, spoiled, stated


@pytest.fixture(scope="module")
def result() -> RefinedResult:
    rng = np.random.default_rng(8)
    scene = random_scene(rng, 30, margin_px=45)
    dirty, _ = spoiled(stated(scene, rng, Misjudged(), baseline=1.03), rng)
    return refine(dirty, Misjudged().settings())


def test_there_and_back(result: RefinedResult) -> None:
    saved = refined_parameters(result, compare_inputs(result).inputs)
    read = RigParameters.loads(saved.dumps())
    assert (read.method, read.purpose) == ("refined", "both")
    np.testing.assert_array_equal(read.primary.K, result.primary.K)
    np.testing.assert_array_equal(read.secondary.K, result.secondary.K)
    np.testing.assert_array_equal(read.pose.R, result.pose.R)
    assert read.uncertainties == saved.uncertainties
    rows = result.dataset.correspondences
    np.testing.assert_array_equal(
        read.reprojection_errors(rows.primary, rows.secondary),
        saved.reprojection_errors(rows.primary, rows.secondary),
    )


def test_what_the_uncertainties_say(result: RefinedResult) -> None:
    stated_ones = refined_parameters(result, compare_inputs(result).inputs).uncertainties
    assert stated_ones is not None
    errors = stated_ones["standard_errors"]
    own = errors_of_set(result)
    assert errors == {name: value.sigma for name, value in own.items()}
    covariance = np.array(stated_ones["covariance"]["matrix"])
    names = stated_ones["covariance"]["of"]
    assert names == list(COVARIANCE_OF[:-2])
    for at, name in enumerate(names):
        if name in errors:
            assert errors[name] == pytest.approx(np.sqrt(covariance[at, at]), rel=1e-12)
    assert [one["frame"] for one in stated_ones["frames_left_out"]] == list(result.outlying_frames)
    assert len(stated_ones["frames_left_out"]) == 3
    assert "the measured baseline is" in stated_ones["inputs_that_disagree"][0]
    assert stated_ones["sigma_px"]["source"] == "estimated from the residuals"
    length = stated_ones["bar_length_m"]
    assert abs(length["estimate"] - length["stated"]) < 4 * Misjudged().bar_m


def test_calibrate_runs_it_beside_the_papers_three() -> None:
    data = rig.dataset(20, 0.2)
    said: list[str] = []
    found = calibrate(data, progress=said.append, refined=RefineSettings())
    assert said == ["screening", "essential", "2d", "3d", "refined"]
    assert list(found.methods) == ["essential", "2d", "3d"]
    assert found.refined is not None
    assert found.errors["refined"].mean_reprojection_px < found.errors["3d"].mean_reprojection_px
    hopeless = RefineSettings(baseline_sigma_m=np.inf, distance_sigma_m=np.inf)
    without = calibrate(data, refined=hopeless)
    assert without.refined is None
    assert "There is no refined set: Nothing fixes the scale" in without.warnings[-1]
