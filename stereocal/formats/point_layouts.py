"""Propose the layout of a point file from its first rows."""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial

from stereocal.errors import StereocalError
from stereocal.formats.column_roles import (
    CALISCOPE,
    MOST_TITLES,
    OPENLPT,
    guess_by_program,
    guess_by_roles,
    propose_roles,
    with_names,
)
from stereocal.formats.exchange.options import LOWER_LEFT, PixelOrigin
from stereocal.formats.other_files import refuse_other_points
from stereocal.formats.point_files import PointColumns, PointLayout, is_number_or_empty
from stereocal.system.csv_text import unquoted
from stereocal.system.dialect import Dialect, dialect_of, encoding_of, head_of, one_line_end
from stereocal.system.numbers import is_number

HEAD_BYTES = 200_000
OURS = "stereocal"
MOST_EMPTY = 8
"""Empty columns at the end that are looked past."""
OWN, TRACKTOR = ("frame", "u", "v"), ("frame", "pos_x", "pos_y")
COUNTED = ("camera_frame", "u", "v")
ASK_LOWER_LEFT = (
    "Are the points counted from the lower left, v' = h - v, with the image height h? Some "
    "programs take h - 1 or h + 1, newer ones count from the upper left."
)
DLTDV = re.compile(r"(.+)_cam(\d+)_([UV]|[XY])")
ARGUS = re.compile(r"(.*?)[ _.-]*cam(?:era)?[ _.-]*(\d+)[ _.-]*([xy])", re.IGNORECASE)
Guess = Callable[[list[list[str]]], PointLayout | None]
"""The layout of first rows; None if they are of another program."""


def propose_layout(content: bytes, source: str, name: str | None = None) -> PointLayout:
    """The layout that fits the first rows of a file.

    Args:
        name: the layout in `LAYOUTS` to use; None: try all.
    """
    rows, dialect = first_rows(content, source)
    known: Mapping[str, Guess] = LAYOUTS
    if name is not None:  # a wand file chosen by the user may have any header
        known = {name: partial(_wand, any_header=True) if name == "wand" else LAYOUTS[name]}
    for guess in known.values():
        for above, width, shape in _shapes(rows):
            if (layout := guess(shape)) is not None:
                found = replace(dialect, above=dialect.above + above)
                layout = replace(layout, dialect=found, width=width)
                return with_names(layout, content, source)
    first = f'its first line is "{dialect.delimiter.join(rows[0])[:100]}".'
    if name is not None:
        raise StereocalError(f"{source}: the file does not have the layout {name}; {first}")
    raise StereocalError(
        f"{source}: the layout is not known. stereocal reads frame,u,v tables, wand files of Argus "
        "and easyWand (4 columns a camera), DLTdv, Argus, DeepLabCut, SLEAP, Tracktor, TrackMate, "
        "Caliscope, OpenLPT, and tables whose header names frame, target, camera, x and y; of any "
        f"other, say what each column holds; {first}"
    )


def layout_name(content: bytes, source: str) -> str | None:
    """The name in `LAYOUTS` of the first layout that fits a file; None if none fits."""
    try:
        rows, _ = first_rows(content, source)
    except StereocalError:
        return None
    shapes = [shape for _, _, shape in _shapes(rows)]
    return next((name for name, guess in LAYOUTS.items() if any(map(guess, shapes))), None)


def _shapes(rows: list[list[str]]) -> Iterator[tuple[int, int | None, list[list[str]]]]:
    """The first rows as they stand, then without titles above them and without empty columns at
    their ends: the number of titles, that of columns if some were left out, and the rows.

    A title that names the columns below it, as of Tracker's several tracks, is a part of their
    names: physics.brocku.ca/Courses/2P20/Tracker, page 21.
    """
    filled = [sum(map(bool, map(str.strip, row))) for row in rows]
    titles = 0
    while (
        titles < min(MOST_TITLES, len(rows) - 2)
        and 2 * filled[titles] < max(filled)
        and not any("\n" in cell for cell in rows[titles])
    ):
        titles += 1
    # Rows of numbers may be titles above a header only: else they are points.
    while titles and any(map(is_number, rows[titles])) and not _has_words(rows[titles - 1]):
        titles -= 1
    for above in range(titles + 1):
        shape = rows[above:]
        if above and filled[above - 1] > 1 and _has_duplicates([*map(str.strip, shape[0])]):
            shape = [_named_above(rows[above - 1], shape[0]), *shape[1:]]
        widest = max(map(len, shape))
        last = max((k for row in shape for k, cell in enumerate(row) if cell.strip()), default=0)
        for width in range(widest, max(last, widest - MOST_EMPTY - 1), -1):
            yield above, width if width < widest else None, [row[:width] for row in shape]


def _has_words(row: list[str]) -> bool:
    return not row or not all(map(is_number_or_empty, row))


def _named_above(names: list[str], header: list[str]) -> list[str]:
    """A header, each cell behind the last name above it."""
    above, named = "", []
    for k, cell in enumerate(header):
        above = "".join(names[k : k + 1]).strip() or above
        named.append(f"{above} {cell}".strip() if cell.strip() else "")
    return named


def first_rows(content: bytes, source: str) -> tuple[list[list[str]], Dialect]:
    """The first eight rows, their numbers with decimal points, and how the table is written."""
    head = content[:HEAD_BYTES]
    text = one_line_end(head.decode(encoding_of(head), errors="replace"))
    if not text.strip():
        raise StereocalError(f"{source}: the file is empty.")
    refuse_other_points(content, source)
    if "\ufffd" in text[:-3] or "\x00" in text:
        raise StereocalError(f"{source}: this is not a text file (CSV in UTF-8).")
    lines = head_of(text)
    if len(content) > HEAD_BYTES and len(lines) > 1:
        lines.pop()  # may be truncated
    dialect = dialect_of(lines)
    rows = dialect.cells("".join(lines[dialect.above :]), source)[:8]
    if len(rows) < 2:
        raise StereocalError(f"{source}: the file has one row only.")
    return [dialect.with_points(row) for row in rows], dialect


def _deeplabcut(rows: list[list[str]]) -> PointLayout | None:
    """Rows scorer, [individuals,] bodyparts, coords; then x, y, likelihood of each part."""
    names = [row[0].strip().lower() if row else "" for row in rows]
    if names[0] != "scorer" or "coords" not in names[:4]:
        return None
    coords = names.index("coords")
    marks = [cell.strip().lower() for cell in rows[coords]]
    columns: list[PointColumns] = []
    for k in (k for k in range(1, len(marks) - 1) if marks[k] == "x"):
        point = " ".join(row[k].strip() for row in rows[1:coords] if k < len(row))
        likelihood = k + 2 if marks[k + 2 : k + 3] == ["likelihood"] else None
        columns.append(PointColumns("cam1", point, k, k + 1, likelihood))
    ask = "How likely must a point be to count? Below 0.6 it is often wrong."
    layout = PointLayout("DeepLabCut", tuple(columns), coords + 1, frame=0, questions=(ask,))
    return layout if columns else None


def _sleap(rows: list[list[str]]) -> PointLayout | None:
    """One row per instance: track, frame_idx, instance.score, then x, y, score of each node."""
    titles = [cell.strip() for cell in rows[0]]
    column = {title: k for k, title in enumerate(titles)}
    columns = tuple(
        PointColumns("cam1", node, k, column[f"{node}.y"], column.get(f"{node}.score"))
        for title, k in column.items()
        if (node := title.removesuffix(".x")) != title and f"{node}.y" in column
    )
    if "frame_idx" not in column or not columns or _has_duplicates(titles):
        return None
    return PointLayout(
        "SLEAP",
        columns,
        frame=column["frame_idx"],
        further=(("track", column["track"]),) if "track" in column else (),
        questions=("How large must a point's score be to count?",),
    )


def _trackmate(rows: list[list[str]]) -> PointLayout | None:
    """Spots: names, two more rows of names, units; older versions have the first row only."""
    names = [cell.strip().upper() for cell in rows[0]]
    if not {"POSITION_X", "POSITION_Y", "FRAME"} <= set(names):
        return None
    x, frame = names.index("POSITION_X"), names.index("FRAME")
    header = 0
    while header < len(rows) and not "".join(rows[header][frame : frame + 1]).strip().isdigit():
        header += 1
    unit = "".join(rows[3][x : x + 1]).strip("() ").lower()[:40] if header == 4 else ""
    ask = f"Positions are in {unit or 'a unit that the file does not name'}: how many pixels is "
    return PointLayout(
        "TrackMate",
        (PointColumns("cam1", "spot", x, names.index("POSITION_Y")),),
        header,
        frame=frame,
        further=(("track", names.index("TRACK_ID")),) if "TRACK_ID" in names else (),
        questions=() if unit in ("pixel", "pixels", "px") else (f"{ask}one unit?",),
    )


def _one_camera(
    rows: list[list[str]], program: str, known: tuple[str, str, str]
) -> PointLayout | None:
    """One row per point of a camera; `known` are the names of frame, u and v."""
    names = [cell.strip().lower() for cell in rows[0]]
    if not {*known} <= {*names} or any(role.kind == "camera" for role in propose_roles(rows)):
        return None
    if program != OURS and _has_duplicates(names):  # our reader reports them
        return None
    frame, u, v = (names.index(name) for name in known)
    further = [k for k, name in enumerate(names) if name and k not in (frame, u, v)]
    return PointLayout(
        program,
        (PointColumns("cam1", "point", u, v),),
        frame=frame,
        further=tuple((unquoted(rows[0][k].strip()), k) for k in further),
    )


def _has_duplicates(names: list[str]) -> bool:
    named = [name for name in names if name]
    return len(set(named)) < len(named)


def _paired(
    program: str, pattern: re.Pattern[str], axes: str, origin: PixelOrigin, rows: list[list[str]]
) -> PointLayout | None:
    """Two columns of each point in each camera, named by point, camera and axis."""
    column = {
        (match[1] or "point", f"cam{match[2]}", match[3].lower()): k
        for k, match in enumerate(pattern.fullmatch(name.strip()) for name in rows[0])
        if match is not None
    }
    wanted = [(point, camera) for point, camera, axis in column if axis == axes[0]]
    only_pairs = len(column) == len(rows[0]) == 2 * len(wanted)
    if not wanted or not only_pairs or not all((*key, axes[1]) in column for key in wanted):
        return None
    columns = tuple(
        PointColumns(camera, point, column[point, camera, axes[0]], column[point, camera, axes[1]])
        for point, camera in wanted
    )
    return _of_cameras(PointLayout(program, columns, origin=origin))


def _wand(rows: list[list[str]], any_header: bool = False) -> PointLayout | None:
    """4 columns per camera: x, y of end A in all cameras, then of end B; the header is optional.

    Args:
        any_header: accept a header that does not name the columns x and y alternately.
    """
    count = len(rows[1])
    headed = not all(is_number_or_empty(cell) for cell in rows[0])
    if count % 4 or not count or not all(is_number_or_empty(cell) for cell in rows[1]):
        return None
    if headed and not any_header and (count < 8 or not _in_turn(rows[0])):
        return None
    cameras = count // 4
    columns = tuple(
        PointColumns(f"cam{k + 1}", end, 2 * (k + half * cameras), 2 * (k + half * cameras) + 1)
        for half, end in enumerate("AB")
        for k in range(cameras)
    )
    program = "a wand file of Argus or easyWand"
    return _of_cameras(PointLayout(program, columns, int(headed), origin=LOWER_LEFT))


def _in_turn(names: list[str]) -> bool:
    """Whether column names alternate in x and y, or u and v, and are equal otherwise."""
    plain = [name.strip().lower() for name in names]
    if len(plain) % 2:
        return False
    for first, second in zip(plain[::2], plain[1::2], strict=True):
        differing = [pair for pair in zip(first, second, strict=False) if pair[0] != pair[1]]
        if len(first) != len(second) or differing not in ([("x", "y")], [("u", "v")]):
            return False
    return True


def _of_cameras(layout: PointLayout) -> PointLayout:
    """A layout of several cameras, with its questions; (0, 0) is a missing point."""
    cameras, points = len(layout.cameras), len(layout.points)
    asked = [f"Is the first pixel (1, 1), at the upper left, as in {layout.program}?"]
    if layout.origin.corner == "lower-left":
        from_1 = f" {layout.program} count u from 1." if layout.origin.first_pixel else ""
        asked = [ASK_LOWER_LEFT + from_1]
    if cameras > 2:
        asked.append(f"Which of the {cameras} cameras are the primary and the secondary?")
    if points > 2:
        asked.append(f"Which two of the {points} points are the ends A and B of the bar?")
    return replace(layout, zero_is_missing=True, questions=tuple(asked))


LAYOUTS: Mapping[str, Guess] = {
    "trackmate": _trackmate,
    "deeplabcut": _deeplabcut,
    "sleap": _sleap,
    "tracktor": lambda rows: _one_camera(rows, "Tracktor", TRACKTOR),
    # (u + 1, h - v), according to its display code.
    "dltdv5": partial(_paired, "DLTdv5 to 7", DLTDV, "xy", replace(LOWER_LEFT, first_pixel=1.0)),
    "dltdv8": partial(_paired, "DLTdv8", DLTDV, "uv", PixelOrigin(first_pixel=1.0)),
    "argus": partial(_paired, "Argus", ARGUS, "xy", LOWER_LEFT),
    "caliscope": partial(guess_by_program, CALISCOPE),
    "openlpt": partial(guess_by_program, OPENLPT),
    "table": lambda rows: (
        _one_camera(rows, OURS, OWN) or _one_camera(rows, OURS, COUNTED) or guess_by_roles(rows)
    ),
    "wand": _wand,
}
"""Layouts by name, in the order in which they are tried."""
