"""Render the sample photographs: `python -m tools.photographs --out sample_data/photographs`."""

import argparse
from pathlib import Path

from stereocal.commands.console import ProgressBar
from stereocal.simulation.simulate import FIELD_FRAMES
from tools.photographs.board_series import LENS_PHOTOGRAPHS
from tools.photographs.sample import write_photographs


def main(arguments: list[str] | None = None) -> None:
    """Write the data set; 11 MB and about a minute as it is shipped."""
    parser = argparse.ArgumentParser(prog="python -m tools.photographs", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the data set")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--frames", type=int, default=FIELD_FRAMES, help="of the bar, a camera")
    parser.add_argument("--boards", type=int, default=LENS_PHOTOGRAPHS, help="a camera")
    asked = parser.parse_args(arguments)
    with ProgressBar("photographs") as bar:
        write_photographs(asked.out, asked.seed, asked.frames, asked.boards, bar.show)


if __name__ == "__main__":
    main()
