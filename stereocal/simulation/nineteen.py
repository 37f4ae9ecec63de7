"""Nineteen synthetic data sets like the paper's (Section 5), with realistic errors.

The same two cameras are set up nineteen times. As their lenses are calibrated once, the error of a
lens is drawn once per camera and is the same in all data sets; it does not average out. Baseline
and bar are measured again for each data set.
"""

from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.pair import Pair
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import (
    TRUTH,
    Nominal,
    Scene,
    field_rig,
    lens_off_by,
    observe,
    place_bars,
)
from stereocal.system.array_types import FloatArray

DATASETS = 19
FRAMES = 25
BASELINES_M = (3.449, 5.936)
"""Shortest and longest measured baseline (paper, Section 5)."""
BARS_M = (0.811, 1.027)
"""Shortest and longest measured distance of the targets (paper, Section 5)."""
NOISE_PX = 0.15
BASELINE_SIGMA_M = 0.005
BAR_SIGMA_M = 0.0005
FOCAL_ERROR = (0.001, 0.003)
"""Relative error of a focal length, of either sign."""
CENTRE_ERROR_PX = (3.0, 5.0)
"""Length of the shift of a principal point, in any direction."""
POSE_SPREAD_RAD = 0.01
"""Standard deviation of each of the five angles of a rig."""
PIXEL_DECIMALS = 3
"""Image points are rounded to 0.001 px, far below the noise, which halves the tables."""


def simulate_nineteen(
    seed: int, datasets: int = DATASETS, frames: int = FRAMES
) -> list[tuple[Scene, Pair]]:
    """The scene and the data set of each, by ascending baseline."""
    if datasets < 1 or frames < 1 or seed < 0:
        raise StereocalError(
            "The numbers of data sets and of frames must be at least 1, the seed at least 0."
        )
    common, *of_datasets = (
        np.random.default_rng(sequence)
        for sequence in np.random.SeedSequence(seed).spawn(1 + datasets)
    )
    rig = field_rig()
    lenses = _with_error(rig.primary, common), _with_error(rig.secondary, common)
    baselines = np.linspace(*BASELINES_M, datasets).round(3)
    bars = common.permutation(np.linspace(*BARS_M, datasets).round(3))
    lengths = zip(baselines.tolist(), bars.tolist(), of_datasets, strict=True)
    return [
        _simulate_one(lenses, baseline_m, bar_m, frames, rng, f"{number:02d}")
        for number, (baseline_m, bar_m, rng) in enumerate(lengths, start=1)
    ]


def _simulate_one(
    lenses: tuple[Camera, Camera],
    baseline_m: float,
    bar_m: float,
    frames: int,
    rng: np.random.Generator,
    name: str,
) -> tuple[Scene, Pair]:
    """One data set with the measured lengths `baseline_m` and `bar_m`.

    The true lengths scatter about the measured ones, so that the measured ones have exactly the
    paper's ranges.
    """
    rig = _set_up(baseline_m + BASELINE_SIGMA_M * rng.standard_normal(), rng)
    scene = place_bars(rig, rng, frames, bar_m + BAR_SIGMA_M * rng.standard_normal())
    notes = f"Synthetic; the truth is in {TRUTH}."
    nominal = Nominal(*lenses, baseline_m, bar_m)
    dataset = observe(scene, rng, NOISE_PX, name, nominal, notes)
    rows = dataset.correspondences
    primary, secondary = (pixels.round(PIXEL_DECIMALS) for pixels in (rows.primary, rows.secondary))
    rounded = replace(rows, primary=primary, secondary=secondary)
    dataset = dataset.changed(correspondences=rounded, baseline_sigma_m=BASELINE_SIGMA_M)
    return scene, dataset.changed(target_distance_sigma_m=BAR_SIGMA_M)


def _set_up(baseline_m: float, rng: np.random.Generator) -> Rig:
    """The field rig with this true baseline and a random error of each angle."""
    rig = field_rig(baseline_m)
    off: FloatArray = POSE_SPREAD_RAD * rng.standard_normal(5)
    angles = Angles(*(np.array(rig.pose.angles) + off).tolist())
    return replace(rig, pose=Pose.from_angles(angles, baseline_m))


def _with_error(camera: Camera, rng: np.random.Generator) -> Camera:
    """The lens with a random calibration error, rounded to 0.01 px."""
    focal = rng.choice([-1.0, 1.0]) * rng.uniform(*FOCAL_ERROR)
    length, direction = rng.uniform(*CENTRE_ERROR_PX), rng.uniform(0.0, 2.0 * np.pi)
    shift = (float(length * np.cos(direction)), float(length * np.sin(direction)))
    wrong = lens_off_by(camera, float(focal), shift)
    return replace(wrong, K=wrong.K.round(2))
