"""Two tags for the ends of the bar, to print at true scale."""

from __future__ import annotations

import numpy as np
from reportlab.graphics.shapes import Group

from stereocal.detection.target import Tags
from stereocal.errors import StereocalError
from stereocal.field.printing.paper import (
    ACTUAL_SIZE,
    MARGIN_MM,
    PAPERS,
    Paper,
    Sheet,
    block,
    footer,
    footer_height,
    stroke,
)
from stereocal.field.printing.print_board import marker_cells
from stereocal.system.numbers import rounded

MARK_MM = 4.0
"""Length of the marks to cut at."""


def print_tags(tags: Tags, side_m: float, paper: Paper) -> Sheet:
    """A sheet with both tags, each with a white border of one cell.

    Args:
        side_m: side of the black square.
    """
    if not (np.isfinite(side_m) and side_m > 0):
        raise StereocalError(f"The side of a tag must be above 0, not {side_m:g} m.")
    side = 1e3 * side_m
    texts = _texts(tags, side)
    places = _places(tags, side, texts, paper)
    if places is None:
        fitting = [name for name, one in PAPERS.items() if _places(tags, side, texts, one)]
        advice = f", or print them on {fitting[0]}" if fitting else ""
        raise StereocalError(
            f"Two tags of {rounded(side, 4)} mm do not fit on {paper.name}: take smaller "
            f"ones{advice}."
        )
    turned, centres = places
    shapes = Group(footer(texts, turned.width_mm))
    for number, (x, y) in zip(tags.ids, centres, strict=True):
        shapes.add(_tag(tags.dictionary, number, x, y, side))
    return Sheet(f"Tags of {rounded(side, 4)} mm", turned, shapes)


def _places(
    tags: Tags, side: float, texts: list[str], paper: Paper
) -> tuple[Paper, list[tuple[float, float]]] | None:
    """The paper, as it lies, and the centres of the tags, mm; None if it is too small."""
    cells = len(marker_cells(f"DICT_{tags.dictionary}", tags.ids[0]))
    whole = side * (cells + 2) / cells + 2.0 * MARK_MM
    for turned in paper.both_ways:
        bottom = footer_height(texts, turned.width_mm)
        width, height = turned.width_mm - 2.0 * MARGIN_MM, turned.height_mm - MARGIN_MM - bottom
        left, top = MARGIN_MM, bottom + height
        if 2 * whole <= width and whole <= height:
            return turned, [(left + part * width, top - 0.5 * height) for part in (0.25, 0.75)]
        if whole <= width and 2 * whole <= height:
            return turned, [(left + 0.5 * width, top - part * height) for part in (0.25, 0.75)]
    return None


def _texts(tags: Tags, side: float) -> list[str]:
    a, b = tags.ids
    return [
        f"stereocal tags, {rounded(side, 4)} mm: A is {a}, B is {b} of {tags.dictionary}. Find "
        f"them with --target tags:{tags.dictionary}:{a},{b}.",
        "Cut at the marks, and leave the border white. Glue them to something flat and matt. The "
        "distance A-B of the bar is measured between the middles of the black squares.",
        f"{ACTUAL_SIZE}, and the black squares {rounded(side, 4)} mm wide and high.",
    ]


def _tag(dictionary: str, number: int, x: float, y: float, side: float) -> Group:
    """A tag around (x, y), with marks at the corners of its white border."""
    marker = marker_cells(f"DICT_{dictionary}", number)
    cell = side / len(marker)
    shapes = Group()
    for row, column in np.argwhere(marker):
        left, top = x - 0.5 * side + column * cell, y + 0.5 * side - row * cell
        shapes.add(block(left, top - cell, cell, cell))
    half = 0.5 * side + cell
    for across in (-1, 1):
        for up in (-1, 1):
            u, v = x + across * half, y + up * half
            shapes.add(stroke(u, v, u + across * MARK_MM, v))
            shapes.add(stroke(u, v, u, v + up * MARK_MM))
    return shapes
