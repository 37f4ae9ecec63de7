"""The user's answers on how to read a point file of another program, stored as JSON.

layout = layout_of(content, "xypts.csv")              # as proposed, or to be chosen by hand
answers = first_answers(layout, 0, image_height=1024)   # to be checked and changed
layout = answered(layout, answers, content, "xypts.csv")
table = read_points(content, layout, answers.camera, answers.image_height)
"""

from dataclasses import dataclass, replace

from stereocal.errors import StereocalError
from stereocal.formats.exchange.options import Corner, Flip, PixelOrigin
from stereocal.formats.point_files import PointColumns, PointLayout
from stereocal.formats.point_layouts import first_rows, is_number, propose_layout

OURS = "stereocal"
UNKNOWN = "a program that is not known"
ONE_CAMERA = "cam1"
"""Camera of a file that names none."""
LIKELY = 0.6
"""DeepLabCut's own threshold: less likely points are often wrong."""


@dataclass(frozen=True)
class Answers:
    """How one point file, or one camera of it, is to be read."""

    camera: str
    corner: Corner = "upper-left"
    flip: Flip = "h"
    first_pixel: float = 0.0
    image_height: int | None = None
    px_per_unit: float = 1.0
    least_likelihood: float = 0.0
    columns: tuple[int | None, int, int] | None = None
    """Columns of the frame (None: rows are counted), u and v if chosen by hand, else None."""


def layout_of(content: bytes, source: str) -> PointLayout:
    """The layout proposed for a file; if none is recognised, one to be chosen by hand."""
    rows, _ = first_rows(content, source)
    try:
        return propose_layout(content, source)
    except StereocalError:
        if len(rows[1]) < 2:
            raise
    return layout_by_hand(content, source)


def layout_by_hand(content: bytes, source: str) -> PointLayout:
    """A table with one row per point, whose columns are to be chosen."""
    rows, dialect = first_rows(content, source)
    header = 0
    while header < len(rows) - 1 and not any(_is_value(cell) for cell in rows[header]):
        header += 1
    return PointLayout(
        program=UNKNOWN,
        columns=(),
        header_rows=header,
        dialect=dialect,
        questions=("Which columns hold the number of the frame, u and v?",),
    )


def can_choose_columns(layout: PointLayout) -> bool:
    """Whether the user can choose the columns of the frame, u and v."""
    return layout.program == UNKNOWN or layout.program.startswith("a table")


def column_names(content: bytes, layout: PointLayout, source: str) -> list[str]:
    """Names of the columns, from the header or by number."""
    rows, _ = first_rows(content, source)
    width = len(rows[min(layout.header_rows, len(rows) - 1)])
    head = rows[layout.header_rows - 1] if layout.header_rows else []
    names = [head[k].strip() if k < len(head) else "" for k in range(width)]
    return [f"{k + 1}: {name[:40]}" if name else f"column {k + 1}" for k, name in enumerate(names)]


def first_answers(layout: PointLayout, which: int, image_height: int | None = None) -> Answers:
    """Initial answers as proposed by the layout.

    Args:
        which: 0 for the primary camera, 1 for the secondary.
        image_height: rows of the image, if known.
    """
    cameras = layout.cameras or (ONE_CAMERA,)
    chosen = can_choose_columns(layout) and layout.columns
    return Answers(
        camera=cameras[min(which, len(cameras) - 1)],
        corner=layout.origin.corner,
        flip=layout.origin.flip,
        first_pixel=layout.origin.first_pixel,
        image_height=image_height,
        px_per_unit=layout.px_per_unit,
        least_likelihood=LIKELY if layout.program == "DeepLabCut" else 0.0,
        columns=(layout.frame, layout.columns[0].u, layout.columns[0].v) if chosen else None,
    )


def answered(layout: PointLayout, answers: Answers, content: bytes, source: str) -> PointLayout:
    """The layout with the answers applied."""
    layout = replace(
        layout,
        origin=PixelOrigin(answers.corner, answers.first_pixel, answers.flip),
        px_per_unit=answers.px_per_unit,
        least_likelihood=answers.least_likelihood,
    )
    if answers.columns is None:
        if not layout.columns:
            raise StereocalError(f"{source}: choose the columns of the frame, u and v.")
        return layout
    if len(set(answers.columns)) < 3:
        raise StereocalError(f"{source}: choose three different columns for the frame, u and v.")
    if not can_choose_columns(layout):
        by_hand = layout_by_hand(content, source)
        layout = replace(by_hand, origin=layout.origin, px_per_unit=layout.px_per_unit)
    return _with_columns(layout, first_rows(content, source)[0], answers.columns)


def _is_value(cell: str) -> bool:
    return cell.strip() != "" and is_number(cell)


def _with_columns(
    layout: PointLayout, rows: list[list[str]], columns: tuple[int | None, int, int]
) -> PointLayout:
    frame, u, v = columns
    head = rows[layout.header_rows - 1] if layout.header_rows else []
    further = tuple(
        (name.strip(), k)
        for k, name in enumerate(head)
        if k not in columns and name.strip() and name.strip().lower() not in ("frame", "u", "v")
    )
    return replace(
        layout, columns=(PointColumns(ONE_CAMERA, "point", u, v),), frame=frame, further=further
    )
