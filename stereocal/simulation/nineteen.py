"""Nineteen synthetic data sets like the paper's (its Section 5), with errors as real ones have.

The same two cameras stand in nineteen places. Their lenses were calibrated once, in the lab, so the
error of a lens is drawn once per camera and is the same in all data sets: it does not average out,
as it does not in the field. Baseline and bar are read anew for each data set.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.camera import Camera
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.geometry import Angles, Pose
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import (
    TRUTH,
    Given,
    Scene,
    field_rig,
    lens_off_by,
    observe,
    place_bars,
)

DATASETS = 19
FRAMES = 25
BASELINES_M = (3.449, 5.936)
"""Shortest and longest baseline as read (paper, Section 5)."""
BARS_M = (0.811, 1.027)
"""Shortest and longest distance of the targets as read (paper, Section 5)."""
NOISE_PX = 0.15
BASELINE_SIGMA_M = 0.005
BAR_SIGMA_M = 0.0005
FOCAL_ERROR = (0.001, 0.003)
"""Relative error of a focal length, of either sign."""
CENTRE_ERROR_PX = (3.0, 5.0)
"""Length of the shift of a principal point, in any direction."""
POSE_SPREAD_RAD = 0.01
"""Each rig is set up by hand: standard deviation of each of its five angles."""
PIXEL_DECIMALS = 3
"""Image points are rounded to 0.001 px, far below the noise: the tables are half as long."""


def simulate_nineteen(
    seed: int, datasets: int = DATASETS, frames: int = FRAMES
) -> list[tuple[Scene, Dataset]]:
    """The truth and the data set of each, in order of the baselines.

    Raises:
        StereocalError: no data sets or frames.
    """
    if datasets < 1 or frames < 1:
        raise StereocalError("The numbers of data sets and of frames must be at least 1.")
    common, *own = (
        np.random.default_rng(sequence)
        for sequence in np.random.SeedSequence(seed).spawn(1 + datasets)
    )
    rig = field_rig()
    lenses = _misjudged(rig.primary, common), _misjudged(rig.secondary, common)
    baselines = np.linspace(*BASELINES_M, datasets).round(3)
    bars = common.permutation(np.linspace(*BARS_M, datasets).round(3))
    return [
        _simulate_one(lenses, float(baselines[i]), float(bars[i]), frames, own[i], f"{i + 1:02d}")
        for i in range(datasets)
    ]


def _simulate_one(
    lenses: tuple[Camera, Camera],
    baseline_m: float,
    bar_m: float,
    frames: int,
    rng: np.random.Generator,
    name: str,
) -> tuple[Scene, Dataset]:
    """One data set; the two lengths are what the range finder reads, rounded to 1 mm.

    The truth lies about the reading and not the other way round, so that the readings span the
    paper's ranges exactly.
    """
    rig = _set_up(baseline_m + BASELINE_SIGMA_M * rng.standard_normal(), rng)
    scene = place_bars(rig, rng, frames, bar_m + BAR_SIGMA_M * rng.standard_normal())
    notes = f"Synthetic; the truth is in {TRUTH}."
    given = Given(*lenses, baseline_m, bar_m)
    dataset = observe(scene, rng, NOISE_PX, name, given, notes)
    rows = dataset.correspondences
    rounded = replace(
        rows,
        primary=rows.primary.round(PIXEL_DECIMALS),
        secondary=rows.secondary.round(PIXEL_DECIMALS),
    )
    return scene, replace(
        dataset,
        correspondences=rounded,
        baseline_sigma_m=BASELINE_SIGMA_M,
        target_distance_sigma_m=BAR_SIGMA_M,
    )


def _set_up(baseline_m: float, rng: np.random.Generator) -> Rig:
    """The field rig with this true baseline, each angle a little off, as set up by hand."""
    rig = field_rig(baseline_m)
    off: FloatArray = POSE_SPREAD_RAD * rng.standard_normal(5)
    angles = Angles(*(np.array(rig.pose.angles) + off).tolist())
    return replace(rig, pose=Pose.from_angles(angles, baseline_m))


def _misjudged(camera: Camera, rng: np.random.Generator) -> Camera:
    """The lens as the lab gives it, to 0.01 px."""
    focal = rng.choice([-1.0, 1.0]) * rng.uniform(*FOCAL_ERROR)
    length, direction = rng.uniform(*CENTRE_ERROR_PX), rng.uniform(0.0, 2.0 * np.pi)
    shift = (float(length * np.cos(direction)), float(length * np.sin(direction)))
    given = lens_off_by(camera, float(focal), shift)
    return replace(given, K=given.K.round(2))
