"""Simulated rigs for the studies of the refined method: truth drawn, then misjudged as stated."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stereocal.dataset import Dataset
from stereocal.geometry import Angles, Pose
from stereocal.simulate import Given, Rig, Scene, lens_off_by, observe, place_bars
from stereocal.unknowns import LensPrior, RefineSettings
from tests import rig

BAR_M = 0.87
DEPTHS_M = (4.0, 10.0)
FRAMES = 25


@dataclass(frozen=True)
class Misjudged:
    """Standard deviations of what is stated: the issue's figures by default; 0 is exact."""

    baseline_m: float = 0.005
    bar_m: float = 0.0005
    focal: float = 0.003
    centre_px: float = 5.0
    noise_px: float = 0.2

    def settings(self) -> RefineSettings:
        """What an experimenter who knows these figures would set."""
        lens = LensPrior(self.focal, self.centre_px)
        return RefineSettings(
            primary=lens,
            secondary=lens,
            baseline_sigma_m=self.baseline_m,
            distance_sigma_m=self.bar_m,
        )


def random_scene(rng: np.random.Generator, frames: int = FRAMES, margin_px: float = 20.0) -> Scene:
    """Two cameras that differ in everything and toe in by a random amount, and the bar."""
    low, high = [0.16, -0.12, -0.15, 0.02, 2.9], [0.32, 0.12, 0.15, 0.2, 3.2]
    pose = Pose.from_angles(Angles(*rng.uniform(low, high).tolist()), rng.uniform(1.8, 2.8))
    cameras = Rig(rig.PRIMARY, rig.SECONDARY, pose)
    return place_bars(cameras, rng, frames, BAR_M, DEPTHS_M, margin_px)


def stated(
    scene: Scene,
    rng: np.random.Generator,
    off: Misjudged,
    baseline: float = 1.0,
    focal: float = 0.0,
    name: str = "rig",
) -> Dataset:
    """The data set with lenses and lengths misjudged at random.

    Args:
        baseline: factor of the baseline as typed, on top.
        focal: further relative error of the primary's focal length.
    """
    cameras = [
        lens_off_by(camera, off.focal * rng.normal(), tuple(off.centre_px * rng.normal(size=2)))
        for camera in (scene.rig.primary, scene.rig.secondary)
    ]
    cameras[0] = lens_off_by(cameras[0], focal, (0.0, 0.0))
    given = Given(
        cameras[0],
        cameras[1],
        (scene.rig.secondary_from_primary.baseline + off.baseline_m * rng.normal()) * baseline,
        scene.bar_length_m + off.bar_m * rng.normal(),
    )
    return observe(scene, rng, off.noise_px, name, given)


def held_out(dataset: Dataset, frames: int) -> tuple[Dataset, Dataset]:
    """All but the last frames, and those."""
    numbers = dataset.correspondences.frames
    return dataset.of_frames(numbers[:-frames]), dataset.of_frames(numbers[-frames:])


def fixed_lenses(settings: RefineSettings) -> RefineSettings:
    """The same with both lenses held."""
    return replace(settings, primary=LensPrior(0.0, 0.0), secondary=LensPrior(0.0, 0.0))
