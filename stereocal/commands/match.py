"""`stereocal match`: match the points of the two cameras."""

from __future__ import annotations

import argparse
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

from stereocal.commands.options import WORKERS, workers_from
from stereocal.commands.parser import ONE_OF, Options
from stereocal.commands.point_options import POINT_OPTIONS, point_tables
from stereocal.commands.progress import ProgressBar, report
from stereocal.errors import StereocalError
from stereocal.matching.matching import match_points
from stereocal.matching.matching_files import match_tables
from stereocal.matching.pairs import POINT
from stereocal.matching.point_table import PointTable
from stereocal.matching.several_files import match_rig
from stereocal.network.rig_file import RigFile
from stereocal.rig.parameters import RigParameters

A_POINT = np.zeros((1, 2))


OPTIONS: Options = {
    "primary": "table frame,u,v,... as CSV or Parquet; or, with --layout, of another program",
    "secondary": "the same for the secondary camera",
    "others": {
        "type": Path,
        "nargs": "*",
        "help": "further cameras, with --rig; each as NAME=FILE",
    },
    ONE_OF: {
        "--parameters FILE": "parameters_2d.json",
        "--rig FILE": "rig.json; tables as NAME=FILE, out: tracks.csv",
    },
    "--out OUT": "pairs.csv or pairs.parquet",
    "--threshold PX": {
        "type": str,
        "help": 'largest reprojection error of a pair in pixels, or "auto" (default): by the noise '
        "of the points",
    },
    "--sigma-px PX": "noise of the points, one standard deviation of a coordinate (default: of "
    "their column sigma_px, or estimated from their epipolar errors)",
    "--depth NEAR FAR": "only pairs at this depth in front of the primary camera, in metres",
    "--unmatched FILE": "write the points without a partner here",
    **WORKERS,
    **POINT_OPTIONS,
}
DEFAULTS = {"depth": (0.0, float("inf"))}


def run(parsed: argparse.Namespace) -> None:
    """Match, write the pairs, print a summary."""
    if parsed.rig is not None:
        _run_rig(parsed)
        return
    if parsed.others:
        raise StereocalError("More than two tables of points need --rig rig.json.")
    rig = RigParameters.load(parsed.parameters)
    threshold = _threshold(parsed.threshold)
    if parsed.unmatched is not None and parsed.unmatched == parsed.out:
        raise StereocalError("--out and --unmatched name the same file.")
    with tempfile.TemporaryDirectory(prefix="stereocal-") as folder:
        primary, secondary = point_tables(parsed, rig, Path(folder))
        compile_first = partial(match_points, rig, A_POINT, A_POINT, 1.0)
        with workers_from(parsed, compile_first) as executor, ProgressBar("frames") as bar:
            matched = match_tables(
                rig,
                primary,
                secondary,
                parsed.out,
                threshold,
                tuple(parsed.depth),
                parsed.unmatched,
                bar.show,
                executor=executor,
                sigma_px=parsed.sigma_px,
            )
    assert matched is not None  # nobody cancels here
    sentences = matched.chosen.sentence(), matched.sentence()
    report(*sentences, notes=matched.notes, written=(parsed.out, parsed.unmatched))


def _run_rig(parsed: argparse.Namespace) -> None:
    """The same of all cameras of a rig."""
    given = {"--threshold": parsed.threshold, "--layout": parsed.layout}
    given["--unmatched"] = parsed.unmatched
    if unused := [option for option, value in given.items() if value is not None]:
        raise StereocalError(f"{unused[0]} is for two cameras: leave it out with --rig.")
    tables: dict[str, PointTable] = {}
    for text in map(str, (parsed.primary, parsed.secondary, *parsed.others)):
        name, equals, file = text.partition("=")
        if not equals or name in tables:
            raise StereocalError(f"{text}: give each camera's points once, as NAME=FILE.")
        tables[name] = PointTable(Path(file), POINT)
    with ProgressBar("frames") as bar:
        found = match_rig(RigFile.load(parsed.rig), tables, parsed.out, parsed.sigma_px, bar.show)
    report(*found.sentences(), notes=found.notes, written=[parsed.out])


def _threshold(text: str | None) -> float | None:
    """None: by the noise of the points."""
    if text is None or text == "auto":
        return None
    try:
        return float(text)
    except ValueError:
        raise StereocalError(
            f'--threshold is "{text}"; it must be a number of pixels, or auto.'
        ) from None
