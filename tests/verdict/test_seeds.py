"""Other seeds of the searches."""

from __future__ import annotations

import numpy as np

from stereocal.refined.unknowns import RefineSettings
from stereocal.verdict.forecast import forecast_files
from stereocal.workflow import calibrate, conclusions_of_seeds, files_of_seed
from tests import known_rig as rig


def test_the_sets_of_a_seed_are_those_of_a_calibration_with_it() -> None:
    calibration = calibrate(rig.dataset(25, 0.2))
    same, other = (files_of_seed(calibration, seed) for seed in (0, 1))
    for method in ("2d", "3d"):
        np.testing.assert_array_equal(same[method].pose.R, calibration.methods[method].pose.R)
        assert not np.array_equal(same[method].pose.R, other[method].pose.R)


def test_a_rig_whose_refined_set_is_the_best_does_not_depend_on_the_seed() -> None:
    calibration = calibrate(rig.dataset(25, 0.2), refined=RefineSettings())
    assert conclusions_of_seeds(calibration, forecast_files(calibration), seeds=(1,)) == ""
