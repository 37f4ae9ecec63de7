"""Options for point files of other programs, the same as the questions on the page."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from stereocal.commands.options import answers, questions
from stereocal.commands.parser import Options
from stereocal.errors import StereocalError
from stereocal.formats.exchange.options import ORIGIN, QUESTIONS
from stereocal.formats.exchange.reading import camera_index
from stereocal.formats.point_answers import (
    OURS,
    Answers,
    answered,
    can_choose_columns,
    column_names,
    first_answers,
    layout_by_hand,
)
from stereocal.formats.point_files import PointLayout, read_points
from stereocal.formats.point_layouts import LAYOUTS, first_rows, layout_name, propose_layout
from stereocal.formats.sleap_h5 import point_text
from stereocal.matching.pairs import POINT
from stereocal.matching.point_table import PointTable
from stereocal.rig.camera import Camera
from stereocal.rig.parameters import RigParameters
from stereocal.system.atomic_files import read_whole

BY_HAND = "columns"
COUNTED = "-"
POINT_OPTIONS: Options = {
    "point files of other programs:": {
        "--layout": {
            "type": str.lower,
            "choices": (*LAYOUTS, BY_HAND),
            "help": "which program wrote both files",
        },
        "--cameras P,S": "primary and secondary camera in the file: 1,2 or names",
        "--columns FRAME U V": "columns by name or number (from 1), with --layout columns or "
        'table; "-" as FRAME counts the rows',
        **questions(*ORIGIN),
        "--px-per-unit N": {"type": float, "help": "pixels in one unit"},
        "--least-likelihood P": "leave out less likely points",
    }
}
"""For files of other programs: the same as the questions on the page."""
WITH_LAYOUT = {
    "cameras": "--cameras",
    "columns": "--columns",
    **{name: QUESTIONS[name].option for name in ORIGIN},
    "px_per_unit": "--px-per-unit",
    "least_likelihood": "--least-likelihood",
}


def two_cameras(text: str) -> tuple[str, str]:
    """The primary and the secondary of `--cameras`."""
    names = [name.strip() for name in text.split(",")]
    if len(names) != 2:
        raise StereocalError(f'--cameras is "{text}"; it must name two, as 1,2.')
    return names[0], names[1]


def point_tables(
    parsed: argparse.Namespace, rig: RigParameters, folder: Path
) -> tuple[PointTable, PointTable]:
    """The points of both cameras; other programs' files are converted into `folder`."""
    given = [option for name, option in WITH_LAYOUT.items() if getattr(parsed, name) is not None]
    if parsed.layout is None and given:
        raise StereocalError(f"{given[0]} is for files of other programs: give --layout too.")
    files = (parsed.primary, rig.primary), (parsed.secondary, rig.secondary)
    first, second = (
        _ours(path) if parsed.layout is None else _theirs(parsed, which, path, camera, folder)
        for which, (path, camera) in enumerate(files)
    )
    return first, second


def _ours(path: Path) -> PointTable:
    """A table `frame,u,v`; the error for another known layout names it."""
    try:
        return PointTable(path, POINT)
    except StereocalError as error:
        if not path.is_file() or path.suffix.lower() in (".parquet", ".pq"):
            raise
        content = point_text(path.read_bytes(), str(path))
        name = layout_name(content, str(path))
        if name is None or propose_layout(content, str(path)).program == OURS:
            raise
        raise StereocalError(f"{path}: looks like the layout {name}: give --layout {name}.") from (
            error
        )


def _theirs(
    parsed: argparse.Namespace, which: int, path: Path, camera: Camera, folder: Path
) -> PointTable:
    source = str(path)
    content = point_text(read_whole(path), source)
    by_hand = parsed.layout == BY_HAND
    layout = (
        layout_by_hand(content, source)
        if by_hand
        else propose_layout(content, source, parsed.layout)
    )
    answers = _answers(parsed, layout, which, camera, content, source)
    layout = answered(layout, answers, content, source)
    table = read_points(content, layout, answers.camera, answers.image_height, source)
    if table.empty:
        raise StereocalError(f"{source}: there is no point of {answers.camera} in the file.")
    print(f"{source}: {_described(layout, answers)}.")
    written = folder / f"{which}.csv"
    table.to_csv(written, index=False, lineterminator="\n")
    return PointTable(written, POINT, source)


def _answers(
    parsed: argparse.Namespace,
    layout: PointLayout,
    which: int,
    camera: Camera,
    content: bytes,
    source: str,
) -> Answers:
    if layout.program == "TrackMate" and layout.questions and parsed.px_per_unit is None:
        raise StereocalError(f"{source}: {layout.questions[0]} Give --px-per-unit.")
    first = first_answers(layout, which, camera.image_size[1])
    values = {
        **answers(parsed),
        "px_per_unit": parsed.px_per_unit,
        "least_likelihood": parsed.least_likelihood,
        "camera": _camera(parsed.cameras, layout, which, source),
        "columns": _columns(parsed.columns, layout, content, source),
    }
    return replace(first, **{name: value for name, value in values.items() if value is not None})


def _camera(text: str | None, layout: PointLayout, which: int, source: str) -> str | None:
    if text is not None:
        wanted = two_cameras(text)[which]
        cameras = layout.cameras
        return wanted if wanted in cameras else cameras[camera_index(wanted, cameras, source)]
    if len(layout.cameras) > 2:
        raise StereocalError(
            f"{source}: the file has {len(layout.cameras)} cameras "
            f"({', '.join(layout.cameras)[:100]}): say which are the primary and the secondary, as "
            "--cameras 1,2."
        )
    return None


def _columns(
    given: list[str] | None, layout: PointLayout, content: bytes, source: str
) -> tuple[int | None, int, int] | None:
    if given is None:
        if not layout.columns:
            raise StereocalError(
                f"{source}: choose the columns, as --columns FRAME U V; the file has "
                f"{', '.join(column_names(content, layout, source))[:200]}."
            )
        return None
    if not can_choose_columns(layout):
        raise StereocalError(f"--columns is for --layout {BY_HAND} and table only.")
    rows, _ = first_rows(content, source)
    names = [name.strip() for name in rows[layout.header_rows - 1]] if layout.header_rows else []
    width = len(rows[min(layout.header_rows, len(rows) - 1)])

    def column(name: str) -> int:
        if name in names:
            return names.index(name)
        if not name.isdecimal() or not 1 <= int(name) <= width:
            raise StereocalError(f"{source}: there is no column {name!r}; it has {width} columns.")
        return int(name) - 1

    frame, u, v = given
    return None if frame == COUNTED else column(frame), column(u), column(v)


def _described(layout: PointLayout, answers: Answers) -> str:
    """How a file was read, in words."""
    flip = f", v = {answers.flip} - v'" if answers.corner == "lower-left" else ""
    left_out = (
        f", points below likelihood {answers.least_likelihood:g} left out"
        if any(each.likelihood is not None for each in layout.columns)
        else ""
    )
    return (
        f"read as {layout.program}, {answers.camera}, counted from the "
        f"{answers.corner.replace('-', ' ')}{flip}, first pixel {answers.first_pixel:g}{left_out}"
    )
