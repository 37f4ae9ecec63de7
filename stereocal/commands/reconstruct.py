"""`stereocal reconstruct`: 3D points of matched pairs."""

import argparse
from functools import partial

import numpy as np

from stereocal.commands.console import ONE_OF, Options, report, with_bar
from stereocal.commands.options import (
    WITH_RIG,
    WORKERS,
    WORLD,
    refuse_given,
    workers_from,
    world_from,
)
from stereocal.matching.matching import refuse_different_rigs
from stereocal.matching.pairs import PIXELS
from stereocal.matching.point_table import PointTable
from stereocal.matching.reconstruction import reconstruct_points
from stereocal.matching.reconstruction_files import reconstruct_table
from stereocal.matching.several_reconstruction import reconstruct_rig
from stereocal.network.rig_file import RigFile
from stereocal.rig.parameters import RigParameters

A_POINT = np.zeros((1, 2))
OPTIONS: Options = {
    "pairs": "pairs.csv or pairs.parquet of match; with --rig its tracks.csv",
    ONE_OF: {
        "--parameters FILE": "parameters_3d.json",
        "--rig FILE": "rig.json: points from all cameras that see them",
    },
    "--out OUT": "points.csv or points.parquet",
    **WORLD,
    "--sigma-px PX": "noise of the points, for the standard errors in metres (default: of the "
    "columns that match writes, or estimated from the pairs; with --rig estimated)",
    "--matched-with FILE": "the parameter file of match: checks that it belongs to the same rig",
    **WORKERS,
}


def run(parsed: argparse.Namespace) -> None:
    """Reconstruct, write the points, print their errors."""
    if parsed.rig is not None:
        refuse_given(parsed, WITH_RIG, "matched_with", "workers", "scheduler")
        files = RigFile.load(parsed.rig), parsed.pairs, parsed.out
        found = reconstruct_rig(*files, world_from(parsed), parsed.sigma_px)
        report(found.sentence(), written=[parsed.out])
        return
    rig = RigParameters.load(parsed.parameters)
    if parsed.matched_with is not None:
        refuse_different_rigs(RigParameters.load(parsed.matched_with), rig)
    pairs = PointTable(parsed.pairs, PIXELS)
    about = rig, pairs, parsed.out, world_from(parsed), parsed.sigma_px
    with workers_from(parsed, partial(reconstruct_points, rig, A_POINT, A_POINT)) as executor:
        measured = with_bar("pairs", partial(reconstruct_table, *about, executor=executor))
    report(measured.sentence(), measured.about_errors, notes=measured.notes, written=[parsed.out])
