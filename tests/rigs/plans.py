"""What the files of one field day measure, whose rig is drawn from its plan."""

import numpy as np

from stereocal.calibration.methods import FILE_METHODS, CalibrationSettings, Method
from stereocal.errors import StereocalError
from stereocal.field.planning.plan import Plan
from stereocal.library.calibrations import calibrate
from stereocal.refined.unknowns import LensPrior, RefineSettings
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Nominal, lens_off_by, observe, place_bars
from tests.rigs.population import population

TEST_BARS = 1000
FIGURES = (
    "mean_length_error",
    "median_error_3d",
    "p95_error_3d",
    "fcp_reprojection",
    "mean_reprojection_px",
)


NAMES = {"mean_length_error": "mean_error_3d"}
"""The names of `population` where they differ."""


def observed(plan: Plan, seed: int) -> dict[tuple[Method, str], float]:
    """The figures of the files of one field day on its population."""
    rng = np.random.default_rng([seed, 0xF1E1D])
    own = plan.uncertainty
    primary, secondary = (
        lens_off_by(camera, own.focal * rng.normal(), tuple(own.centre_px * rng.normal(size=2)))
        for camera in (plan.primary, plan.secondary)
    )
    baseline = plan.baseline_m + own.baseline_m * rng.normal()
    bar = plan.bar_m + own.bar_m * rng.normal()
    truth = Rig(primary, secondary, Pose(plan.pose.R, plan.pose.T * baseline / plan.baseline_m))
    depths, nominal = (
        (plan.near_m, plan.far_m),
        Nominal(plan.primary, plan.secondary, plan.baseline_m, plan.bar_m),
    )
    scene = place_bars(truth, rng, plan.frames, bar, depths)
    dataset = observe(scene, rng, plan.noise_px, plan.name, nominal)
    lens = LensPrior(own.focal, own.centre_px)
    settings = RefineSettings(lens, lens, own.baseline_m, own.bar_m)
    found = calibrate(dataset, CalibrationSettings(), refined=settings)
    files = {m: Rig(plan.primary, plan.secondary, r.pose) for m, r in found.methods.items()}
    refined = found.refined
    if refined is None:
        raise StereocalError("There is no refined set.")
    files["refined"] = Rig(refined.primary, refined.secondary, refined.pose)
    test = place_bars(truth, rng, TEST_BARS, bar, depths)
    limits: dict[Method, float] = dict.fromkeys(files, 1.0)
    figures = population(truth, files, test.ends_m, plan.noise_px, limits, rng)
    return {
        (method, name): figures[method][NAMES.get(name, name)]
        for method in FILE_METHODS
        for name in FIGURES
    }
