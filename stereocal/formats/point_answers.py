"""The user's answers on how to read a point file of another program, stored as JSON.

layout = layout_of(content, "xypts.csv")              # as proposed, or to be chosen by hand
answers = first_answers(layout, 0, image_height=1024)   # to be checked and changed
layout = answered(layout, answers, content, "xypts.csv")
table = read_points(content, layout, answers.camera, answers.image_height)
"""

from contextlib import suppress
from dataclasses import dataclass, replace

from stereocal.errors import StereocalError
from stereocal.formats.column_roles import (
    ONE_CAMERA,
    ROLES_HELP,
    column_titles,
    header_row,
    layout_of_roles,
    parse_roles,
    problem_of,
    propose_roles,
    roles_text,
    with_names,
)
from stereocal.formats.exchange.options import Corner, Flip, PixelOrigin
from stereocal.formats.point_files import PointLayout
from stereocal.formats.point_layouts import first_rows, propose_layout

UNKNOWN = "a table whose columns are not all known"
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
    roles: str | None = None
    """What each column holds, as of `column_roles`, if that is chosen; None: as the layout says."""


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
    """A table whose columns are to be chosen, with the roles that its header names."""
    rows, dialect = first_rows(content, source)
    roles = propose_roles(rows[header_row(rows) :])
    return PointLayout(UNKNOWN, (), dialect=dialect, roles=roles_text(roles))


def layout_as_stated(content: bytes, source: str, roles: str, for_bars: bool) -> PointLayout:
    """A table by the roles of its columns that a person states.

    Raises:
        StereocalError: these columns do not give points.
    """
    rows, dialect = first_rows(content, source)
    parsed = parse_roles(roles, source)
    width = max(map(len, rows))
    if len(parsed) > width:
        raise StereocalError(f"{source}: {len(parsed)} columns are named; the file has {width}.")
    if problem := problem_of(parsed, for_bars):
        raise StereocalError(f"{source}: {problem}")
    with suppress(StereocalError):
        # With what a program's table has besides, if these are its roles.
        proposed = propose_layout(content, source)
        if (proposed.roles or "").rstrip(",-") == roles_text(parsed).rstrip(",-"):
            return proposed
    return with_names(replace(layout_of_roles(parsed, rows), dialect=dialect), content, source)


def what_is_missing(layout: PointLayout, content: bytes, source: str) -> str:
    """What a table by hand lacks, its columns, and how to say what they hold."""
    titles = column_titles(first_rows(content, source)[0])
    roles = parse_roles(layout.roles or "-", source)
    return (
        f"{problem_of(roles, True)} Its columns are {', '.join(titles)[:300]}; they are read as "
        f"--roles {roles_text(roles)[:300]}: correct that, with {ROLES_HELP}."
    )


def header_of(content: bytes, source: str) -> str:
    """The same for files with the same header: they are asked about once."""
    return "\n".join(column_titles(first_rows(content, source)[0])).lower()


def answers_alike(given: Answers, content: bytes, source: str, of_given: bytes) -> Answers | None:
    """The answers on one camera's file for the other's, if it has the same header.

    None: it must be asked about. Of a file with two cameras, the other one is taken.
    """
    if given.corner != "upper-left" or header_of(content, source) != header_of(of_given, source):
        return None
    layout = answered(layout_of(content, source), given, content, source)
    others = [camera for camera in layout.cameras if camera != given.camera]
    if len(layout.cameras) > 2:
        return None
    return replace(given, camera=(others or [given.camera])[0])


def first_answers(layout: PointLayout, which: int, image_height: int | None = None) -> Answers:
    """Initial answers as proposed by the layout.

    Args:
        which: 0 for the primary camera, 1 for the secondary.
        image_height: rows of the image, if known.
    """
    cameras = layout.cameras or (ONE_CAMERA,)
    return Answers(
        camera=cameras[min(which, len(cameras) - 1)],
        corner=layout.origin.corner,
        flip=layout.origin.flip,
        first_pixel=layout.origin.first_pixel,
        image_height=image_height,
        px_per_unit=layout.px_per_unit,
        least_likelihood=LIKELY if layout.program == "DeepLabCut" else 0.0,
        roles=layout.roles,
    )


def answered(layout: PointLayout, answers: Answers, content: bytes, source: str) -> PointLayout:
    """The layout with the answers applied."""
    if answers.roles is not None:
        layout = layout_as_stated(content, source, answers.roles, False)
    return replace(
        layout,
        origin=PixelOrigin(answers.corner, answers.first_pixel, answers.flip),
        px_per_unit=answers.px_per_unit,
        least_likelihood=answers.least_likelihood,
    )
