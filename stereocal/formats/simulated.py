"""Write simulated data sets in the format of recorded ones, with their true parameters."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np

from stereocal.formats.dataset_files import TABLE, pack_dataset
from stereocal.simulation.board_series import LENS_PHOTOGRAPHS
from stereocal.simulation.nineteen import DATASETS, FRAMES, NOISE_PX, simulate_nineteen
from stereocal.simulation.sample_photographs import (
    JPEG_QUALITY,
    JPEG_QUALITY_HIDDEN,
    PhotographedField,
    jpeg,
    prepare_photographs,
    true_of_photographs,
)
from stereocal.simulation.simulate import (
    FIELD_BAR_M,
    FIELD_BASELINE_M,
    FIELD_FRAMES,
    FIELD_NOISE_PX,
    TRUTH,
    Nominal,
    observe,
    simulate_field,
    truth_of,
)
from stereocal.system.atomic_files import write_atomically
from stereocal.system.tasks import Progress


def write_field(folder: Path, seed: int) -> None:
    """Write the sample field as a data set folder with `truth.json`.

    Raises:
        StereocalError: the folder cannot be written to.
    """
    scene, dataset = simulate_field(seed)
    truth = truth_of(scene, FIELD_NOISE_PX, seed)
    files = {**pack_dataset(dataset), TRUTH: (json.dumps(truth, indent=2) + "\n").encode()}
    for name, content in files.items():
        write_atomically(folder / name, content)


def write_nineteen(folder: Path, seed: int, datasets: int = DATASETS, frames: int = FRAMES) -> None:
    """Write the data sets as the folders `01`, `02`, ... with `truth.json` in each.

    Raises:
        StereocalError: no data sets or frames, or the folder cannot be written to.
    """
    for number, (scene, dataset) in enumerate(simulate_nineteen(seed, datasets, frames), start=1):
        truth = truth_of(scene, NOISE_PX, seed)
        files = {**pack_dataset(dataset), TRUTH: (json.dumps(truth, indent=1) + "\n").encode()}
        for name, content in files.items():
            write_atomically(folder / f"{number:02d}" / name, content)


def write_photographs(
    folder: Path,
    seed: int,
    frames: int = FIELD_FRAMES,
    boards: int = LENS_PHOTOGRAPHS,
    progress: Progress = lambda _done, _total: None,
) -> None:
    """Write a data set of photographs: `primary/0001.jpg`, ..., `boards_primary/`, and the truth.

    There is no table of points; they are to be detected.

    Args:
        progress: called with the number of photographs written and the total.

    Raises:
        StereocalError: the folder cannot be written to.
    """
    field = prepare_photographs(seed, frames, boards)
    for name, content in describing_files(field).items():
        write_atomically(folder / name, content)
    total = 2 * (frames + boards)
    done = 0
    for pair in field.pairs():
        quality = JPEG_QUALITY_HIDDEN if field.is_hidden(pair.frame) else JPEG_QUALITY
        for which, image in (("primary", pair.primary), ("secondary", pair.secondary)):
            name = f"{pair.frame:04d}.jpg"
            write_atomically(folder / which / name, jpeg(image, quality))
        done += 2
        progress(done, total)
    for which in field.cameras:
        for number, image in enumerate(field.board_photographs(which), start=1):
            name = f"{number:04d}.jpg"
            write_atomically(folder / f"boards_{which}" / name, jpeg(image, JPEG_QUALITY))
            done += 1
            progress(done, total)


def describing_files(field: PhotographedField) -> dict[str, bytes]:
    """`dataset.json`, the two camera files and `truth.json`."""
    nominal = replace(
        Nominal.exact(field.scene), baseline_m=FIELD_BASELINE_M, target_distance_m=FIELD_BAR_M
    )
    notes = f"Synthetic photographs, seed {field.seed}; the truth is in {TRUTH}."
    exact = observe(field.scene, np.random.default_rng(0), 0.0, "photographs", nominal, notes)
    files = {name: content for name, content in pack_dataset(exact).items() if name != TABLE}
    return {**files, TRUTH: (json.dumps(true_of_photographs(field), indent=2) + "\n").encode()}
