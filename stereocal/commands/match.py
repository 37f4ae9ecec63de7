"""`stereocal match`: match the points of the two cameras, or of all cameras of a rig.

Options for point files of other programs are the same as the questions on the page.
"""

import argparse
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np

from stereocal.commands.console import ONE_OF, Number, Options, report, with_bar
from stereocal.commands.options import (
    WITH_RIG,
    WORKERS,
    answers,
    questions,
    refuse_given,
    two_cameras,
    workers_from,
)
from stereocal.errors import StereocalError
from stereocal.fit.rig_file import RigFile
from stereocal.formats import point_answers
from stereocal.formats.column_roles import ROLES_HELP, UNUSED, Kind, Role, column_titles, roles_text
from stereocal.formats.exchange.chosen_cameras import camera_indices
from stereocal.formats.exchange.options import ORIGIN, QUESTIONS
from stereocal.formats.other_files import is_workbook
from stereocal.formats.point_answers import what_is_missing
from stereocal.formats.point_files import PointLayout, read_points
from stereocal.formats.point_layouts import LAYOUTS, OURS, first_rows, layout_name, propose_layout
from stereocal.formats.point_text import point_text
from stereocal.matching.match_tables import match_tables
from stereocal.matching.matching import ANY_DEPTH
from stereocal.matching.names import AUTO
from stereocal.matching.point_table import PointTable, is_parquet
from stereocal.matching.settled import Stated
from stereocal.matching.view_groups import ViewFitter, match_views
from stereocal.rig.camera import CAMERAS, Camera, CameraName
from stereocal.rig.parameters import RigParameters
from stereocal.system.atomic_files import read_whole
from stereocal.system.numbers import POSSIBLE_M, POSSIBLE_PX

BY_HAND = "columns"
COUNTED = "-"
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
        "type": Number(float, 0.0, POSSIBLE_PX[1], AUTO),
        "help": 'largest reprojection error of a pair in pixels, or "auto" (default): by the noise '
        "of the points",
    },
    "--sigma-px PX": "noise of the points, one standard deviation of a coordinate (default: of "
    "their column sigma_px, or estimated from their epipolar errors; with --rig always estimated, "
    "from their errors in all cameras)",
    "--depth NEAR FAR": "only pairs at this depth in front of the primary camera, in metres",
    "--names COLUMN": "the column of all tables that names their points (several: with commas); "
    'only points of one name belong together. "auto" (default): point, bodypart, node, track and '
    'the like, if the images agree; "none": names are not used',
    "--unmatched FILE": "write the points without a partner here",
    **WORKERS,
    "point files of other programs:": {
        "--layout": {
            "type": str.lower,
            "choices": (*LAYOUTS, BY_HAND),
            "help": "which program wrote both files",
        },
        "--cameras P,S": "primary and secondary camera in the file: 1,2 or names",
        "--columns FRAME U V": "columns by name or number (from 1), with --layout columns or "
        'table; "-" as FRAME counts the rows',
        "--roles ROLES": ROLES_HELP,
        **questions(*ORIGIN),
        "--px-per-unit N": {"type": Number(float, *POSSIBLE_M), "help": "pixels in one unit"},
        "--least-likelihood P": "leave out less likely points",
    },
}
OF_LAYOUT = ("cameras", "columns", "roles", "px_per_unit", "least_likelihood")
WITH_LAYOUT = {name: f"--{name.replace('_', '-')}" for name in OF_LAYOUT}
WITH_LAYOUT |= {name: QUESTIONS[name].option for name in ORIGIN}


def run(parsed: argparse.Namespace) -> None:
    """Match, write what belongs together, print a summary."""
    if parsed.unmatched is not None and parsed.unmatched == parsed.out:
        raise StereocalError("--out and --unmatched name the same file.")
    rig, tables = _of_rig(parsed) if parsed.rig is not None else _of_pair(parsed)
    threshold = None if parsed.threshold == AUTO else parsed.threshold
    depths = tuple(parsed.depth or ANY_DEPTH)
    stated = Stated(threshold, depths, parsed.sigma_px, parsed.names or AUTO)
    files = partial(match_tables, rig, tables, parsed.out, stated, parsed.unmatched)
    a_point = [np.zeros((1, 2))] * len(rig.placed)
    with workers_from(parsed, partial(match_views, ViewFitter(rig), a_point, 1.0)) as executor:
        matched = with_bar("frames", partial(files, executor=executor))
    report(*matched.sentences, notes=matched.notes, written=(parsed.out, parsed.unmatched))


def _of_pair(parsed: argparse.Namespace) -> tuple[RigParameters, dict[str, PointTable]]:
    if parsed.others:
        raise StereocalError("More than two tables of points need --rig rig.json.")
    rig = RigParameters.load(parsed.parameters)
    stated = [option for name, option in WITH_LAYOUT.items() if getattr(parsed, name) is not None]
    if parsed.layout is None and stated:
        raise StereocalError(f"{stated[0]} is for files of other programs: give --layout too.")
    return rig, {
        which: _ours(getattr(parsed, which))
        if parsed.layout is None
        else _theirs(parsed, which, getattr(rig, which))
        for which in CAMERAS
    }


def _of_rig(parsed: argparse.Namespace) -> tuple[RigFile, dict[str, PointTable]]:
    refuse_given(parsed, WITH_RIG, "threshold", "depth", "layout", *WITH_LAYOUT)
    tables: dict[str, PointTable] = {}
    for text in map(str, (parsed.primary, parsed.secondary, *parsed.others)):
        name, equals, file = text.partition("=")
        if not equals or name in tables:
            raise StereocalError(f"{text}: give each camera's points once, as NAME=FILE.")
        tables[name] = PointTable(Path(file))
    return RigFile.load(parsed.rig), tables


def _ours(path: Path) -> PointTable:
    """A table `frame,u,v`; the error for another known layout names it."""
    try:
        return PointTable(path)
    except StereocalError as error:
        if not path.is_file() or is_parquet(path):
            raise
        given = path.read_bytes()
        content = point_text(given, str(path))
        name = layout_name(content, str(path))
        is_own = propose_layout(content, str(path)).program == OURS if name else False
        if name is None or (is_own and not is_workbook(given)):
            raise
        hint = f"{path}: looks like the layout {name}: give --layout {name}."
        raise StereocalError(hint) from error


def _theirs(parsed: argparse.Namespace, which: CameraName, camera: Camera) -> PointTable:
    source, k = str(getattr(parsed, which)), CAMERAS.index(which)
    content = point_text(read_whole(source), source)
    if parsed.layout == BY_HAND:
        layout = point_answers.layout_by_hand(content, source)
    else:
        layout = propose_layout(content, source, parsed.layout)
    if layout.program == "TrackMate" and layout.questions and parsed.px_per_unit is None:
        raise StereocalError(f"{source}: {layout.questions[0]} Give --px-per-unit.")
    stated = {
        **answers(parsed),
        "px_per_unit": parsed.px_per_unit,
        "least_likelihood": parsed.least_likelihood,
        "camera": _camera(parsed.cameras, layout.cameras, k, source),
        "roles": _roles(parsed, layout, content, source),
    }
    chosen = replace(
        point_answers.first_answers(layout, k, camera.image_size[1]),
        **{name: value for name, value in stated.items() if value is not None},
    )
    layout = point_answers.answered(layout, chosen, content, source)
    table = read_points(content, layout, chosen.camera, chosen.image_height, source)
    if table.empty:
        raise StereocalError(f"{source}: there is no point of {chosen.camera} in the file.")
    corner = chosen.corner.replace("-", " ")
    flip = f", v = {chosen.flip} - v'" if chosen.corner == "lower-left" else ""
    line = f"{source}: read as {layout.program}, {chosen.camera}, counted from the {corner}{flip}"
    line += f", first pixel {chosen.first_pixel:g}"
    if any(point.likelihood is not None for point in layout.columns):
        line += f", points below likelihood {chosen.least_likelihood:g} left out"
    print(f"{line}.")
    table.index += 2  # lines, of a table with one line above
    return PointTable(table, label=source)


def _camera(text: str | None, cameras: tuple[str, ...], which: int, source: str) -> str | None:
    if text is not None:
        wanted = two_cameras(text)[which]
        return cameras[camera_indices([wanted], cameras, source)[0]]
    if len(cameras) > 2:
        raise StereocalError(
            f"{source}: the file has {len(cameras)} cameras ({', '.join(cameras)[:100]}): say "
            "which are the primary and the secondary, as --cameras 1,2."
        )
    return None


def _roles(
    parsed: argparse.Namespace, layout: PointLayout, content: bytes, source: str
) -> str | None:
    """What each column holds, of `--roles` or `--columns`; None: as the layout says."""
    if parsed.columns is None and parsed.roles is None:
        if not layout.columns:
            raise StereocalError(f"{source}: {what_is_missing(layout, content, source)}")
        return None
    if layout.roles is None:
        raise StereocalError(f"--columns and --roles are for --layout {BY_HAND} and table only.")
    if parsed.columns is None:
        return str(parsed.roles)
    titles = column_titles(first_rows(content, source)[0])
    known = {str(k + 1): k for k in range(len(titles))}
    known |= {name: k for k, name in enumerate(titles)}
    roles = [UNUSED] * len(titles)
    for name, kind in zip(parsed.columns, ("frame", "x", "y"), strict=True):
        if name == COUNTED and kind == "frame":
            continue
        if name not in known:
            raise StereocalError(
                f"{source}: there is no column {name!r}; it has {len(titles)} columns, "
                f"{', '.join(titles)[:200]}."
            )
        if roles[known[name]] != UNUSED:
            raise StereocalError(
                f"{source}: choose three different columns for the frame, u and v."
            )
        roles[known[name]] = Role(cast(Kind, kind))
    return roles_text(roles)
