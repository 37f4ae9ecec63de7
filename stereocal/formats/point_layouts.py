"""Which program wrote a point file: a layout proposed from its first rows."""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

from stereocal.errors import StereocalError
from stereocal.formats.other_files import refuse_other_points
from stereocal.formats.pixel_origin import PixelOrigin
from stereocal.formats.point_files import PointColumns, PointLayout

HEAD_BYTES = 200_000
LOWER_LEFT = PixelOrigin("lower-left")
OLD_DLTDV = PixelOrigin("lower-left", first_pixel=1.0)
"""DLTdv5 to 7: (u + 1, h - v), from their own display code."""
ONE_BASED = PixelOrigin("upper-left", first_pixel=1.0)
ASK_LOWER_LEFT = (
    "Are the points counted from the lower left, v' = h - v, with the image height h? Some "
    "programs take h - 1 or h + 1, newer ones count from the upper left."
)
ASK_CAMERAS = "Which of the {count} cameras are the primary and the secondary?"
ASK_ENDS = "Which two of the {count} points are the ends A and B of the bar?"
FRAME_NAMES = ("frame", "frames", "frame_number", "image", "t", "time", "index")
U_NAMES = ("u", "x", "x_px", "col", "column", "position_x", "x_position", "cx", "centroid_x")
V_NAMES = ("v", "y", "y_px", "row", "position_y", "y_position", "cy", "centroid_y")


def propose_layout(content: bytes, source: str, name: str | None = None) -> PointLayout:
    """The layout that the first rows of a file look like, or the one of this name in `LAYOUTS`.

    Raises:
        StereocalError: empty, no text, or like no layout that is known, or not like this one.
    """
    rows, delimiter = first_rows(content, source)
    for guess in LAYOUTS.values() if name is None else (LAYOUTS[name],):
        layout = guess(rows, delimiter)
        if name == "wand":  # a person says it, whatever the header
            layout = _wand(rows, delimiter, any_header=True)
        if layout is not None:
            return layout
    first = f'its first line is "{delimiter.join(rows[0])[:100]}".'
    if name is not None:
        raise StereocalError(f"{source}: this is no file of the layout {name}; {first}")
    raise StereocalError(
        f"{source}: the layout is not known. stereocal reads frame,u,v tables, wand files of Argus "
        "and easyWand (4 columns a camera), DLTdv, Argus, DeepLabCut, SLEAP, Tracktor and "
        f"TrackMate; {first}"
    )


def layout_name(content: bytes, source: str) -> str | None:
    """The name in `LAYOUTS` of the layout that a file looks like; None where it looks like none."""
    try:
        rows, delimiter = first_rows(content, source)
    except StereocalError:
        return None
    return next((name for name, guess in LAYOUTS.items() if guess(rows, delimiter)), None)


def first_rows(content: bytes, source: str) -> tuple[list[list[str]], str]:
    """The first eight rows as text, and what stands between their columns.

    Raises:
        StereocalError: empty, no text, or one row only.
    """
    head = content[:HEAD_BYTES]
    text = head.decode("utf-8-sig", errors="replace")
    if not text.strip():
        raise StereocalError(f"{source}: the file is empty.")
    refuse_other_points(content, source)
    if "\ufffd" in text[:-3] or "\x00" in text:
        raise StereocalError(f"{source}: this is not a text file (CSV in UTF-8).")
    lines = text.splitlines()
    if len(content) > HEAD_BYTES and len(lines) > 1:
        lines.pop()  # it may be cut off
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
    """A row for an instance: track, frame_idx, instance.score, then x, y, score of each node."""
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
    if "frame_idx" not in names or not columns:
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
    if not {"frame", "pos_x", "pos_y"} <= set(names):
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


def _dltdv(rows: list[list[str]], delimiter: str, newer: bool) -> PointLayout | None:
    """`pt1_cam1_X,pt1_cam1_Y,...` of DLTdv5 to 7, `<name>_cam1_U,<name>_cam1_V,...` of DLTdv8."""
    columns = _paired(rows[0], re.compile(r"(.+)_cam(\d+)_([UV]|[XY])"), "UV" if newer else "XY")
    if columns is None:
        return None
    layout = PointLayout(
        program="DLTdv8" if newer else "DLTdv5 to 7",
        columns=columns,
        header_rows=1,
        delimiter=delimiter,
        origin=ONE_BASED if newer else OLD_DLTDV,
        zero_is_missing=True,
    )
    ask_origin = "Is the first pixel (1, 1), at the upper left, as in DLTdv8?"
    return _asking(layout, ask_origin if newer else f"{ASK_LOWER_LEFT} DLTdv5 to 7 count u from 1.")


def _argus(rows: list[list[str]], delimiter: str) -> PointLayout | None:
    """`<track>_cam_1_x,<track>_cam_1_y,<track>_cam_2_x,...` and names like these."""
    name = re.compile(r"(.*?)[ _.-]*cam(?:era)?[ _.-]*(\d+)[ _.-]*([xy])", re.IGNORECASE)
    columns = _paired(rows[0], name, "xy")
    if columns is None:
        return None
    layout = PointLayout(
        program="Argus",
        columns=columns,
        header_rows=1,
        delimiter=delimiter,
        origin=LOWER_LEFT,
        zero_is_missing=True,
    )
    return _asking(layout, ASK_LOWER_LEFT)


def _paired(
    names: list[str], pattern: re.Pattern[str], axes: str
) -> tuple[PointColumns, ...] | None:
    """Columns named by point, camera and axis, two and two; None where any is not."""
    found = [pattern.fullmatch(name.strip()) for name in names]
    at = {
        (match[1] or "point", f"cam{match[2]}", match[3].lower()): k
        for k, match in enumerate(found)
        if match is not None
    }
    first, second = axes[0].lower(), axes[1].lower()
    wanted = [(point, camera) for point, camera, axis in at if axis == first]
    if not wanted or len(at) != len(names) or 2 * len(wanted) != len(names):
        return None
    if not all((*each, second) in at for each in wanted):
        return None
    return tuple(
        PointColumns(camera, point, at[point, camera, first], at[point, camera, second])
        for point, camera in wanted
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
    """A row a point, with a frame column: ours, and others by the names of their columns."""
    names = [cell.strip().lower() for cell in rows[0]]
    at = [
        next((names.index(name) for name in known if name in names), None)
        for known in (FRAME_NAMES, U_NAMES, V_NAMES)
    ]
    frame, u, v = at
    if frame is None or u is None or v is None:
        return None
    ours = [names[k] for k in (frame, u, v)] == ["frame", "u", "v"]
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


def _wand(rows: list[list[str]], delimiter: str, any_header: bool = False) -> PointLayout | None:
    """4 columns a camera: x, y of end A in all cameras, then of end B; with a header or without.

    A header must name the columns x and y in turn, or it is that of some other table.

    Args:
        any_header: a person says that it is one.
    """
    count = len(rows[1])
    headed = not all(is_number(cell) for cell in rows[0])
    if count % 4 or not count or not all(is_number(cell) for cell in rows[1]):
        return None
    if headed and not any_header and (count < 8 or not _in_turn(rows[0])):
        return None
    cameras = count // 4
    columns = tuple(
        PointColumns(f"cam{k + 1}", end, 2 * (k + half * cameras), 2 * (k + half * cameras) + 1)
        for half, end in enumerate("AB")
        for k in range(cameras)
    )
    layout = PointLayout(
        program="a wand file of Argus or easyWand",
        columns=columns,
        header_rows=int(headed),
        delimiter=delimiter,
        origin=LOWER_LEFT,
        zero_is_missing=True,
    )
    return _asking(layout, ASK_LOWER_LEFT)


def _in_turn(names: list[str]) -> bool:
    """Whether columns are called x and y, or u and v, in turn, and alike but for that."""
    plain = [name.strip().lower() for name in names]
    return len(plain) % 2 == 0 and all(
        any(first.replace(x, y) == second and x in first for x, y in (("x", "y"), ("u", "v")))
        for first, second in zip(plain[::2], plain[1::2], strict=True)
    )


def _asking(layout: PointLayout, ask_origin: str) -> PointLayout:
    questions = [ask_origin]
    if len(layout.cameras) > 2:
        questions.append(ASK_CAMERAS.format(count=len(layout.cameras)))
    if len(layout.points) > 2:
        questions.append(ASK_ENDS.format(count=len(layout.points)))
    return replace(layout, questions=tuple(questions))


def is_number(text: str) -> bool:
    """Whether a cell is empty or a number."""
    try:
        float(text.strip() or "nan")
    except ValueError:
        return False
    return True


LAYOUTS: Mapping[str, Callable[[list[list[str]], str], PointLayout | None]] = {
    "trackmate": _trackmate,
    "deeplabcut": _deeplabcut,
    "sleap": _sleap,
    "tracktor": _tracktor,
    "dltdv5": partial(_dltdv, newer=False),
    "dltdv8": partial(_dltdv, newer=True),
    "argus": _argus,
    "table": _long_table,
    "wand": _wand,
}
"""Layouts by name, in the order in which a file is compared with them."""
