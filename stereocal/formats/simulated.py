"""Write simulated data sets in the format of recorded ones, with their true parameters."""

from __future__ import annotations

import json
from pathlib import Path

from stereocal.formats.dataset_files import pack_dataset
from stereocal.simulation.nineteen import DATASETS, FRAMES, NOISE_PX, simulate_nineteen
from stereocal.simulation.simulate import FIELD_NOISE_PX, TRUTH, simulate_field, truth_of
from stereocal.system.atomic_files import write_atomically


def write_field(folder: Path, seed: int) -> None:
    """Write the sample field as a data set folder with `truth.json`."""
    scene, dataset = simulate_field(seed)
    truth = truth_of(scene, FIELD_NOISE_PX, seed)
    files = {**pack_dataset(dataset), TRUTH: (json.dumps(truth, indent=2) + "\n").encode()}
    for name, content in files.items():
        write_atomically(folder / name, content)


def write_nineteen(folder: Path, seed: int, datasets: int = DATASETS, frames: int = FRAMES) -> None:
    """Write the data sets as the folders `01`, `02`, ... with `truth.json` in each."""
    for number, (scene, dataset) in enumerate(simulate_nineteen(seed, datasets, frames), start=1):
        truth = truth_of(scene, NOISE_PX, seed)
        files = {**pack_dataset(dataset), TRUTH: (json.dumps(truth, indent=1) + "\n").encode()}
        for name, content in files.items():
            write_atomically(folder / f"{number:02d}" / name, content)
