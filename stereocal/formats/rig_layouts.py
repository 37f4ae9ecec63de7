"""Layouts of point files with several cameras: DLTdv, Argus, easyWand."""

from __future__ import annotations

import re
from dataclasses import replace

from stereocal.formats.pixel_origin import PixelOrigin
from stereocal.formats.point_files import PointColumns, PointLayout

LOWER_LEFT = PixelOrigin("lower-left")
OLD_DLTDV = PixelOrigin("lower-left", first_pixel=1.0)
"""DLTdv5 to 7: (u + 1, h - v), according to their display code."""
ONE_BASED = PixelOrigin("upper-left", first_pixel=1.0)
ASK_LOWER_LEFT = (
    "Are the points counted from the lower left, v' = h - v, with the image height h? Some "
    "programs take h - 1 or h + 1, newer ones count from the upper left."
)
ASK_CAMERAS = "Which of the {count} cameras are the primary and the secondary?"
ASK_ENDS = "Which two of the {count} points are the ends A and B of the bar?"


def dltdv_layout(rows: list[list[str]], delimiter: str, newer: bool) -> PointLayout | None:
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


def argus_layout(rows: list[list[str]], delimiter: str) -> PointLayout | None:
    """`<track>_cam_1_x,<track>_cam_1_y,<track>_cam_2_x,...` and similar names."""
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
    """Pairs of columns named by point, camera and axis; None if any column is not."""
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


def wand_layout(
    rows: list[list[str]], delimiter: str, any_header: bool = False
) -> PointLayout | None:
    """4 columns per camera: x, y of end A in all cameras, then of end B; the header is optional.

    Args:
        any_header: accept a header that does not name the columns x and y alternately.
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
    """Whether column names alternate in x and y, or u and v, and are equal otherwise."""
    plain = [name.strip().lower() for name in names]
    return len(plain) % 2 == 0 and all(
        len(first) == len(second)
        and [pair for pair in zip(first, second, strict=True) if pair[0] != pair[1]]
        in ([("x", "y")], [("u", "v")])
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
