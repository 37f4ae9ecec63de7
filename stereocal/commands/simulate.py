"""`stereocal simulate`: write the synthetic sample data."""

from __future__ import annotations

import argparse
from pathlib import Path

from stereocal.errors import StereocalError
from stereocal.formats.simulated import write_field, write_nineteen


def add(command: argparse.ArgumentParser) -> None:
    """The options of the command."""
    command.add_argument("--datasets", type=int, default=19, metavar="N", help="default: 19")
    command.add_argument("--frames", type=int, default=25, metavar="N", help="default: 25")
    command.add_argument("--out", type=Path, required=True, help="folder for the data sets")
    command.add_argument("--seed", type=int, default=0, metavar="N", help="default: 0")


def run(parsed: argparse.Namespace) -> None:
    """Write the data sets with their ground truth."""
    for name in ("seed", "datasets", "frames"):
        lowest = 0 if name == "seed" else 1
        if getattr(parsed, name) < lowest:
            raise StereocalError(f"--{name} must be at least {lowest}.")
    write_field(parsed.out / "field", parsed.seed)
    print(f"wrote {parsed.out / 'field'}")
    write_nineteen(parsed.out / "nineteen", parsed.seed, parsed.datasets, parsed.frames)
    print(f"wrote {parsed.out / 'nineteen'}")
