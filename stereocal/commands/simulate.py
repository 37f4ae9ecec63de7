"""`stereocal simulate`: write the synthetic sample data."""

import argparse
import json
from pathlib import Path

from stereocal.commands.console import Number, Options, report
from stereocal.formats.dataset_files import pack_dataset
from stereocal.rig.pair import Pair
from stereocal.simulation.nineteen import NOISE_PX, simulate_nineteen
from stereocal.simulation.simulate import FIELD_NOISE_PX, TRUTH, simulate_field, truth_of
from stereocal.system.atomic_files import write_all
from stereocal.system.numbers import SEEDS

OPTIONS: Options = {
    "--datasets N": "default: 19",
    "--frames N": "default: 25",
    "--out OUT": "folder for the data sets",
    "--seed N": {"type": Number(int, *SEEDS), "help": "default: 0"},
}
DEFAULTS = {"datasets": 19, "frames": 25, "seed": 0}


def run(parsed: argparse.Namespace) -> None:
    field, nineteen = parsed.out / "field", parsed.out / "nineteen"
    write_field(field, parsed.seed)
    report(written=[field])
    simulated = simulate_nineteen(parsed.seed, parsed.datasets, parsed.frames)
    for number, (scene, dataset) in enumerate(simulated, start=1):
        truth = json.dumps(truth_of(scene, NOISE_PX, parsed.seed), indent=1)
        _write(nineteen / f"{number:02d}", dataset, truth)
    report(written=[nineteen])


def write_field(folder: Path, seed: int) -> None:
    """Write the sample field as a data set folder with `truth.json`."""
    scene, dataset = simulate_field(seed)
    _write(folder, dataset, json.dumps(truth_of(scene, FIELD_NOISE_PX, seed), indent=2))


def _write(folder: Path, dataset: Pair, truth: str) -> None:
    files = {**pack_dataset(dataset), TRUTH: f"{truth}\n".encode()}
    write_all({folder / name: content for name, content in files.items()})
