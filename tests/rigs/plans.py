"""What the files of one field day measure, whose rig is drawn from its plan."""

import numpy as np

from stereocal.calibration.methods import FILE_METHODS, Method
from stereocal.errors import StereocalError
from stereocal.field.planning.plan import Plan
from stereocal.library.calibrations import calibrate
from stereocal.rig.geometry import Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Nominal, observe, place_bars
from tests.rigs.population import population
from tests.rigs.refined_rigs import Misjudged, misjudged

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
    off = Misjudged(own.baseline_m, own.bar_m, own.focal, own.centre_px, plan.noise_px)
    planned, depths = Rig(plan.primary, plan.secondary, plan.pose), (plan.near_m, plan.far_m)
    nominal = Nominal(plan.primary, plan.secondary, plan.baseline_m, plan.bar_m)
    true = misjudged(planned, plan.bar_m, rng, off)
    pose = Pose(plan.pose.R, plan.pose.T * true.baseline_m / plan.baseline_m)
    truth, bar = Rig(true.primary, true.secondary, pose), true.target_distance_m
    scene = place_bars(truth, rng, plan.frames, bar, depths)
    dataset = observe(scene, rng, plan.noise_px, plan.name, nominal)
    found = calibrate(dataset, refined=off.settings())
    files = {m: Rig(plan.primary, plan.secondary, r.pose) for m, r in found.methods.items()}
    refined = found.refined
    if refined is None:
        raise StereocalError("There is no refined set.")
    files["refined"] = refined.rig
    test = place_bars(truth, rng, TEST_BARS, bar, depths)
    limits: dict[Method, float] = dict.fromkeys(files, 1.0)
    figures = population(truth, files, test.ends_m, plan.noise_px, limits, rng)
    return {
        (method, name): figures[method][NAMES.get(name, name)]
        for method in FILE_METHODS
        for name in FIGURES
    }
