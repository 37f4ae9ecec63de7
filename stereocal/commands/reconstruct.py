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
from stereocal.fit.rig_file import Parameters, RigFile
from stereocal.matching.matching import refuse_different_rigs
from stereocal.matching.measure_tables import measure_tables
from stereocal.matching.views import views_of
from stereocal.rig.parameters import RigParameters

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
    rig = _rig(parsed)
    table, world = views_of(rig).table(parsed.pairs), world_from(parsed)
    a_point = np.zeros((1, len(rig.placed), 2))
    with workers_from(parsed, partial(views_of(rig).fit, a_point, 1.0)) as executor:
        measure = partial(measure_tables, rig, table, parsed.out, world, parsed.sigma_px)
        measured = with_bar("pairs", partial(measure, executor=executor))
    report(*measured.sentences, notes=measured.notes, written=[parsed.out])


def _rig(parsed: argparse.Namespace) -> Parameters:
    if parsed.rig is not None:
        refuse_given(parsed, WITH_RIG, "matched_with", "workers", "scheduler")
        return RigFile.load(parsed.rig)
    rig = RigParameters.load(parsed.parameters)
    if parsed.matched_with is not None:
        refuse_different_rigs(RigParameters.load(parsed.matched_with), rig)
    return rig
