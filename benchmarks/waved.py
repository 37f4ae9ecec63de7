"""Simulated recordings of a bar that is waved in front of the cameras.

    python -m benchmarks.waved [--rigs 4]

The bar is at another place every 10, 20 or 40 of 200 frames; both lenses have a smooth error of
0.2 px rms that no model contains. How many of the stated 95 % intervals hold on 100 further frames.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from benchmarks.halves import FIGURES
from stereocal.calibration.methods import Method
from stereocal.refined.unknowns import RefineSettings
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.simulation.simulate import Nominal, observe
from stereocal.verdict.forecast import forecast_files
from stereocal.workflow import calibrate
from tests.rigs.population import figures_on
from tests.rigs.refined_rigs import (
    Misjudged,
    random_rig,
    stated,
    waved_scene,
)

WAVES = 6
NOISE_PX, MISFIT_PX = 0.2, 0.2
FRAMES, FURTHER = 200, 100
METHODS: tuple[Method, ...] = ("2d", "3d", "refined")


def smooth_fields(rng: np.random.Generator) -> FloatArray:
    """(4, WAVES, 4): waves of an error of the lens for each of u, v in both cameras.

    Each has two wave numbers, in waves across the image, a phase, and an amplitude.
    """
    numbers = rng.uniform(-1.5, 1.5, (4, WAVES, 2))
    phases = rng.uniform(0, 2 * np.pi, (4, WAVES, 1))
    return np.concatenate([numbers, phases, rng.standard_normal((4, WAVES, 1))], axis=2)


def misfit(dataset: Dataset, fields: FloatArray, rms_px: float) -> Dataset:
    """The data set seen with errors of the lenses that vary smoothly over the images."""
    rows = dataset.correspondences
    size = float(max(dataset.primary.image_size))
    moved = []
    for pixels, waves in ((rows.primary, fields[:2]), (rows.secondary, fields[2:])):
        angles = 2 * np.pi * np.einsum("nk,awk->naw", pixels / size, waves[:, :, :2])
        found = np.sum(waves[:, :, 3] * np.cos(angles + waves[:, :, 2]), axis=2)
        moved.append(pixels + rms_px * found / np.sqrt(0.5 * np.square(waves[:, :, 3]).sum(axis=1)))
    changed = replace(rows, primary=moved[0], secondary=moved[1])
    return replace(dataset, correspondences=changed)


def held(length: int, seed: int) -> list[tuple[bool, float]]:
    """Of each file and figure whether its interval holds, and its width over the value."""
    rng = np.random.default_rng([seed, length, 5])
    cameras, fields = random_rig(rng), smooth_fields(rng)
    scene = waved_scene(cameras, rng, FRAMES, length)
    off = Misjudged(0.0, 0.0, 0.0, 0.0, NOISE_PX)
    data = misfit(stated(scene, rng, off), fields, MISFIT_PX)
    further = waved_scene(cameras, rng, FURTHER, length)
    test = observe(further, rng, NOISE_PX, "further", Nominal.exact(scene))
    outlook = forecast_files(calibrate(data, refined=RefineSettings()))
    found = []
    for method in METHODS:
        true = figures_on(misfit(test, fields, MISFIT_PX), outlook.files[method])
        for name in FIGURES:
            said = getattr(outlook.predictive.forecasts[method], name)
            holds = said.low <= true[name] <= said.high
            found.append((holds, (said.high - said.low) / said.value))
    return found


def main() -> None:
    """All lengths of runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rigs", type=int, default=4)
    rigs = parser.parse_args().rigs
    for length in (10, 20, 40):
        found = np.array([each for seed in range(rigs) for each in held(length, seed)])
        print(
            f"{length} frames: {100 * found[:, 0].mean():.0f} % of {len(found)} hold, median width "
            f"{np.median(found[:, 1]):.2f}"
        )


if __name__ == "__main__":
    main()
