"""`stereocal simulate`: write the synthetic sample data."""

from __future__ import annotations

import argparse

from stereocal.commands.parser import Options
from stereocal.errors import StereocalError
from stereocal.formats.simulated import write_field, write_nineteen

OPTIONS: Options = {
    "--datasets N": "default: 19",
    "--frames N": "default: 25",
    "--out OUT": "folder for the data sets",
    "--seed N": "default: 0",
}
DEFAULTS = {"datasets": 19, "frames": 25, "seed": 0}


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
