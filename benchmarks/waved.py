"""Simulated recordings of a bar that is waved in front of the cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.refined_rigs import BAR_M, DEPTHS_M
from stereocal.rig.compiled import FloatArray
from stereocal.rig.dataset import Dataset
from stereocal.rig.rig import Rig
from stereocal.simulation.simulate import Scene, place_bars

WAVES = 6
MARGIN_PX = 60.0


def waved_scene(cameras: Rig, rng: np.random.Generator, frames: int, length: int) -> Scene:
    """A bar that is somewhere else, in another direction, every `length` frames."""
    keys = place_bars(cameras, rng, frames // length + 2, BAR_M, DEPTHS_M, MARGIN_PX).ends_m
    middles, halves = keys.mean(axis=1), 0.5 * (keys[:, 0] - keys[:, 1])
    at, part = np.divmod(np.arange(frames), length)
    share = (part / length)[:, None]
    middle = (1 - share) * middles[at] + share * middles[at + 1]
    # Of two ways round the shorter one.
    flip = np.where(np.sum(halves[at] * halves[at + 1], axis=1) < 0, -1.0, 1.0)[:, None]
    half = (1 - share) * halves[at] + share * flip * halves[at + 1]
    half *= 0.5 * BAR_M / np.linalg.norm(half, axis=1, keepdims=True)
    return Scene(cameras, np.stack([middle + half, middle - half], axis=1))


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
