"""Several tables of a bar's ends as one: a table for each camera, each end, or each end and camera.

A table for each camera names its points by columns, or has tracks: by a column (trackpy's
`particle`), or two columns for each (Kinovea's `Trajectory 1/X`, Tracker's `#multi:`). Of a table
for each end and camera, the names of the files tell which.
"""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import PurePath

import pandas as pd

from stereocal.errors import StereocalError
from stereocal.formats.column_roles import (
    BY_ROLES,
    ONE_CAMERA,
    counts_own,
    ends_and_cameras,
    own_count_of,
    parse_roles,
    problem_of,
    titles_name_cameras,
)
from stereocal.formats.exchange.options import ExchangeOptions
from stereocal.formats.point_answers import (
    first_answers,
    layout_as_stated,
    layout_by_hand,
    layout_of,
    what_is_missing,
)
from stereocal.formats.point_files import PointLayout, read_points, times_in, with_words
from stereocal.formats.point_layouts import OURS, propose_layout
from stereocal.matching.names import TRACKS
from stereocal.matching.point_table import OWN_FRAME
from stereocal.system.csv_text import csv_text

OF_TRACKS = (*TRACKS, "particle", "trajectory", "object")
"""Columns that name the tracks of one camera; `particle` is trackpy's."""


def layout_of_table(
    content: bytes, source: str, options: ExchangeOptions, for_bars: bool = True
) -> PointLayout:
    """The layout of a table as the options state it, or as it is recognised.

    Args:
        for_bars: it must have both ends in two cameras, where the options state its columns.
    """
    if options.roles is not None:
        return layout_as_stated(content, source, options.roles, for_bars)
    try:
        return propose_layout(content, source, options.layout)
    except StereocalError:
        layout = layout_of(content, source)
        is_complete = not problem_of(parse_roles(layout.roles or "-", source), for_bars)
        if layout.columns or options.layout is not None or is_complete:
            raise
        raise StereocalError(f"{source}: {what_is_missing(layout, content, source)}") from None


def one_table(tables: Mapping[str, bytes], options: ExchangeOptions) -> bytes:
    """The points of several tables as one with columns frame, camera, target, x and y; and
    camera_frame, each camera's own count, if all have it."""
    layouts: Mapping[str, PointLayout] = {
        name: _with_tracks(layout_of_table(content, name, options, False), content, name)
        for name, content in tables.items()
    }
    stems = {name: PurePath(name).stem for name in tables}
    if not all(map(_is_of_cameras, layouts.values())):
        layouts = {name: _columns_as_points(layout) for name, layout in layouts.items()}
    several = {(len(layout.cameras) > 1, len(layout.points) > 1) for layout in layouts.values()}
    named: Mapping[str, tuple[str, str]] = {}
    if several == {(False, False)}:
        named = ends_and_cameras(stems)
    elif several == {(False, True)}:
        named = {name: (stem, "") for name, stem in stems.items()}
    elif several == {(True, False)}:
        named = {name: ("", stem) for name, stem in stems.items()}
    if not named:
        raise StereocalError(
            f"these are {len(tables)} tables, and it is not clear which end of the bar in which "
            "camera each has. Give one for each camera with both ends; or one for each end and "
            "camera, called A_left.csv, A_right.csv, B_left.csv and B_right.csv; or one of all, "
            "with columns camera and target.",
            ", ".join(tables),
        )
    layouts = _at_frames(layouts, tables)
    parts = []
    for name, (camera, end) in named.items():
        likely = first_answers(layouts[name], 0).least_likelihood
        layout = replace(layouts[name], least_likelihood=likely)
        own = own_count_of(layout)
        for column in layout.cameras:
            part = read_points(tables[name], layout, column, None, name)
            if own is not None:
                part[OWN_FRAME] = part["frame" if counts_own(layout) else layout.titles[own]]
            part = part.assign(target=end) if end else part.rename(columns={"point": "target"})
            parts.append(part.assign(camera=camera or column))
    table = pd.concat(parts).rename(columns={"u": "x", "v": "y"})
    frames = [] if all(map(counts_own, layouts.values())) else ["frame"]
    if OWN_FRAME in table and table[OWN_FRAME].notna().all():
        frames.append(OWN_FRAME)
    return csv_text(table[[*frames, "camera", "target", "x", "y"]]).encode()


def _with_tracks(layout: PointLayout, content: bytes, source: str) -> PointLayout:
    """The layout of a table of one camera, whose points are its tracks if it names no others."""
    if max(len(layout.cameras), len(layout.points)) > 1:
        return layout
    for _, column in (pair for pair in layout.further if pair[0].strip().lower() in OF_TRACKS):
        tracked = with_words(content, replace(layout, point_column=column), source)
        if len(tracked.points) > 1:
            return tracked
    if layout.program == OURS and layout.further:  # another column may name the ends
        roles = layout_by_hand(content, source).roles or ""
        by_roles = layout_as_stated(content, source, roles, False)
        return by_roles if len(by_roles.points) > 1 else layout
    return layout


def _is_of_cameras(layout: PointLayout) -> bool:
    """Whether what a table calls cameras are cameras, or it calls none so."""
    by_header = layout.program == BY_ROLES and layout.camera_column is None
    return len(layout.cameras) < 2 or not by_header or titles_name_cameras(layout.titles)


def _columns_as_points(layout: PointLayout) -> PointLayout:
    """The layout with the words that were read as cameras as points of one camera."""
    if len(layout.cameras) < 2 or len(layout.points) > 1:
        return layout
    columns = (replace(c, camera=ONE_CAMERA, point=f"{c.point} {c.camera}") for c in layout.columns)
    return replace(layout, columns=tuple(columns))


def _at_frames(
    layouts: Mapping[str, PointLayout], tables: Mapping[str, bytes]
) -> Mapping[str, PointLayout]:
    """The layouts, which count the frames of all tables alike if one has times in their place."""
    every = (times_in(tables[name], layout, name) for name, layout in layouts.items())
    if not (stated := [*filter(None, every)]):
        return layouts
    first, step = map(min, zip(*stated, strict=True))
    return {name: replace(layout, times=(first, step)) for name, layout in layouts.items()}
