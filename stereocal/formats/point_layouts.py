"""Propose the layout of a point file from its first rows."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Mapping
from functools import partial

from stereocal.errors import StereocalError
from stereocal.formats.other_files import refuse_other_points
from stereocal.formats.point_files import PointColumns, PointLayout
from stereocal.formats.rig_layouts import argus_layout, dltdv_layout, wand_layout

HEAD_BYTES = 200_000
FRAME_NAMES = ("frame", "frames", "frame_number", "image", "t", "time", "index")
U_NAMES = ("u", "x", "x_px", "col", "column", "position_x", "x_position", "cx", "centroid_x")
V_NAMES = ("v", "y", "y_px", "row", "position_y", "y_position", "cy", "centroid_y")


def propose_layout(content: bytes, source: str, name: str | None = None) -> PointLayout:
    """The layout that fits the first rows of a file.

    Args:
        name: the layout in `LAYOUTS` to use; None: try all.
    """
    rows, delimiter = first_rows(content, source)
    for guess in LAYOUTS.values() if name is None else (LAYOUTS[name],):
        layout = guess(rows, delimiter)
        if name == "wand":  # chosen by the user, with any header
            layout = wand_layout(rows, delimiter, any_header=True)
        if layout is not None:
            return layout
    first = f'its first line is "{delimiter.join(rows[0])[:100]}".'
    if name is not None:
        raise StereocalError(f"{source}: the file does not have the layout {name}; {first}")
    raise StereocalError(
        f"{source}: the layout is not known. stereocal reads frame,u,v tables, wand files of Argus "
        "and easyWand (4 columns a camera), DLTdv, Argus, DeepLabCut, SLEAP, Tracktor and "
        f"TrackMate; {first}"
    )


def layout_name(content: bytes, source: str) -> str | None:
    """The name in `LAYOUTS` of the first layout that fits a file; None if none fits."""
    try:
        rows, delimiter = first_rows(content, source)
    except StereocalError:
        return None
    return next((name for name, guess in LAYOUTS.items() if guess(rows, delimiter)), None)


def first_rows(content: bytes, source: str) -> tuple[list[list[str]], str]:
    """The first eight rows as text, and their delimiter."""
    head = content[:HEAD_BYTES]
    text = head.decode("utf-8-sig", errors="replace")
    if not text.strip():
        raise StereocalError(f"{source}: the file is empty.")
    refuse_other_points(content, source)
    if "\ufffd" in text[:-3] or "\x00" in text:
        raise StereocalError(f"{source}: this is not a text file (CSV in UTF-8).")
    lines = text.splitlines()
    if len(content) > HEAD_BYTES and len(lines) > 1:
        lines.pop()  # may be truncated
    delimiter = max(",;\t", key=lines[0].count)
    try:
        rows = list(csv.reader(io.StringIO("\n".join(lines[:8])), delimiter=delimiter))
    except csv.Error as error:
        raise StereocalError(f"{source}: this is not a CSV file ({error}).") from error
    if len(rows) < 2:
        raise StereocalError(f"{source}: the file has one row only.")
    return rows, delimiter


def _deeplabcut(rows: list[list[str]], delimiter: str) -> PointLayout | None:
    """Rows scorer, [individuals,] bodyparts, coords; then x, y, likelihood of each part."""
    names = [row[0].strip().lower() if row else "" for row in rows]
    if names[0] != "scorer" or "coords" not in names[:4]:
        return None
    coords = names.index("coords")
    labels = [rows[k] for k in range(1, coords)]
    marks = [cell.strip().lower() for cell in rows[coords]]
    columns = [
        PointColumns(
            "cam1",
            " ".join(row[k].strip() for row in labels if k < len(row)),
            k,
            k + 1,
            k + 2 if marks[k + 2 : k + 3] == ["likelihood"] else None,
        )
        for k in range(1, len(marks) - 1)
        if marks[k] == "x"
    ]
    if not columns:
        return None
    return PointLayout(
        program="DeepLabCut",
        columns=tuple(columns),
        header_rows=coords + 1,
        delimiter=delimiter,
        frame=0,
        questions=("How likely must a point be to count? Below 0.6 it is often wrong.",),
    )


def _sleap(rows: list[list[str]], delimiter: str) -> PointLayout | None:
    """One row per instance: track, frame_idx, instance.score, then x, y, score of each node."""
    names = [cell.strip() for cell in rows[0]]
    columns = [
        PointColumns(
            "cam1",
            node,
            k,
            names.index(f"{node}.y"),
            names.index(f"{node}.score") if f"{node}.score" in names else None,
        )
        for k, name in enumerate(names)
        if (node := name.removesuffix(".x")) != name and f"{node}.y" in names
    ]
    if "frame_idx" not in names or not columns or _has_duplicates(names):
        return None
    return PointLayout(
        program="SLEAP",
        columns=tuple(columns),
        header_rows=1,
        delimiter=delimiter,
        frame=names.index("frame_idx"),
        further=(("track", names.index("track")),) if "track" in names else (),
        questions=("How large must a point's score be to count?",),
    )


def _tracktor(rows: list[list[str]], delimiter: str) -> PointLayout | None:
    """`,frame,pos_x,pos_y[,id]`; the first column numbers the rows."""
    names = [cell.strip().lower() for cell in rows[0]]
    if not {"frame", "pos_x", "pos_y"} <= set(names) or _has_duplicates(names):
        return None
    frame, u, v = (names.index(name) for name in ("frame", "pos_x", "pos_y"))
    return PointLayout(
        program="Tracktor",
        columns=(PointColumns("cam1", "point", u, v),),
        header_rows=1,
        delimiter=delimiter,
        frame=frame,
        further=tuple((name, k) for k, name in enumerate(names) if name and k not in (frame, u, v)),
    )


def _trackmate(rows: list[list[str]], delimiter: str) -> PointLayout | None:
    """Spots: names, two more rows of names, units; older versions have the first row only."""
    names = [cell.strip().upper() for cell in rows[0]]
    if not {"POSITION_X", "POSITION_Y", "FRAME"} <= set(names):
        return None
    x, frame = names.index("POSITION_X"), names.index("FRAME")
    header = 0
    while header < len(rows) and not "".join(rows[header][frame : frame + 1]).strip().isdigit():
        header += 1
    unit = "".join(rows[3][x : x + 1]).strip("() ").lower()[:40] if header == 4 else ""
    questions = []
    if unit not in ("pixel", "pixels", "px"):
        questions.append(
            f"Positions are in {unit or 'a unit that the file does not name'}: how many pixels is "
            "one unit?"
        )
    return PointLayout(
        program="TrackMate",
        columns=(PointColumns("cam1", "spot", x, names.index("POSITION_Y")),),
        header_rows=header,
        delimiter=delimiter,
        frame=frame,
        further=(("track", names.index("TRACK_ID")),) if "TRACK_ID" in names else (),
        questions=tuple(questions),
    )


def _long_table(rows: list[list[str]], delimiter: str) -> PointLayout | None:
    """One row per point, with a frame column: ours, and others by their column names."""
    names = [cell.strip().lower() for cell in rows[0]]
    at = [
        next((names.index(name) for name in known if name in names), None)
        for known in (FRAME_NAMES, U_NAMES, V_NAMES)
    ]
    frame, u, v = at
    if frame is None or u is None or v is None:
        return None
    ours = [names[k] for k in (frame, u, v)] == ["frame", "u", "v"]
    if _has_duplicates(names) and not ours:  # the reader of ours reports duplicates
        return None
    asked = (
        f"Are the columns {names[frame]}, {names[u]} and {names[v]} frame, u and v, with the "
        "centre of the top-left pixel at (0, 0)?"
    )
    return PointLayout(
        program="stereocal" if ours else "a table with a row for each point",
        columns=(PointColumns("cam1", "point", u, v),),
        header_rows=1,
        delimiter=delimiter,
        frame=frame,
        further=tuple(
            (rows[0][k].strip(), k)
            for k in range(len(names))
            if names[k] and k not in (frame, u, v)
        ),
        questions=() if ours else (asked,),
    )


def _has_duplicates(names: list[str]) -> bool:
    named = [name for name in names if name]
    return len(set(named)) < len(named)


LAYOUTS: Mapping[str, Callable[[list[list[str]], str], PointLayout | None]] = {
    "trackmate": _trackmate,
    "deeplabcut": _deeplabcut,
    "sleap": _sleap,
    "tracktor": _tracktor,
    "dltdv5": partial(dltdv_layout, newer=False),
    "dltdv8": partial(dltdv_layout, newer=True),
    "argus": argus_layout,
    "table": _long_table,
    "wand": wand_layout,
}
"""Layouts by name, in the order in which they are tried."""
