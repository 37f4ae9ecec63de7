"""`stereocal reconstruct`: 3D points of matched pairs."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import numpy as np

from stereocal.commands.options import add_workers, workers_from
from stereocal.commands.progress import ProgressBar
from stereocal.formats.world_file import read_world
from stereocal.matching.matching import refuse_different_rigs
from stereocal.matching.point_table import PointTable
from stereocal.matching.reconstruction import reconstruct_points
from stereocal.matching.reconstruction_files import PIXELS, reconstruct_table
from stereocal.matching.several_files import reconstruct_rig
from stereocal.network.rig_file import RigFile
from stereocal.rig.parameters import RigParameters

A_POINT = np.zeros((1, 2))


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """The options of the command."""
    command = commands.add_parser("reconstruct", help="3D points of matched pairs")
    command.set_defaults(run=run)
    command.add_argument(
        "pairs", type=Path, help="pairs.csv or pairs.parquet of match; with --rig its tracks.csv"
    )
    parameters = command.add_mutually_exclusive_group(required=True)
    parameters.add_argument("--parameters", type=Path, metavar="FILE", help="parameters_3d.json")
    parameters.add_argument(
        "--rig", type=Path, metavar="FILE", help="rig.json: points from all cameras that see them"
    )
    command.add_argument("--out", type=Path, required=True, help="points.csv or points.parquet")
    command.add_argument(
        "--world",
        type=Path,
        metavar="FILE",
        help="world.json of the command world, or a 4x4 matrix (JSON or CSV) from the primary "
        "camera's coordinates to yours",
    )
    command.add_argument(
        "--sigma-px",
        type=float,
        metavar="PX",
        help="noise of the points, for the standard errors in metres (default: of the columns "
        "that match writes, or estimated from the pairs)",
    )
    command.add_argument(
        "--matched-with",
        type=Path,
        metavar="FILE",
        help="the parameter file of match: checks that it belongs to the same rig",
    )
    add_workers(command)


def run(parsed: argparse.Namespace) -> None:
    """Reconstruct, write the points, print their errors."""
    if parsed.rig is not None:
        world = None if parsed.world is None else read_world(parsed.world)
        own = RigFile.load(parsed.rig)
        print(reconstruct_rig(own, parsed.pairs, parsed.out, world, parsed.sigma_px).sentence())
        print(f"wrote {parsed.out}")
        return
    rig = RigParameters.load(parsed.parameters)
    if parsed.matched_with is not None:
        refuse_different_rigs(RigParameters.load(parsed.matched_with), rig)
    world = None if parsed.world is None else read_world(parsed.world)
    pairs = PointTable(parsed.pairs, PIXELS)
    compile_first = partial(reconstruct_points, rig, A_POINT, A_POINT)
    with workers_from(parsed, compile_first) as executor, ProgressBar("pairs") as bar:
        report = reconstruct_table(
            rig, pairs, parsed.out, world, parsed.sigma_px, bar.show, executor=executor
        )
    assert report is not None  # nobody cancels here
    print(report.sentence())
    print(report.about_errors)
    for note in report.notes:
        print(f"Note: {note}")
    print(f"wrote {parsed.out}")
