"""What is printed at true scale: the targets and tags of the bar, the board for the lenses."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache

import cv2
import numpy as np
from reportlab.graphics.shapes import Group, Rect

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
from stereocal.rig.rigid_object import BoardPattern
from stereocal.system.array_types import BoolArray
from stereocal.system.numbers import rounded

MARK_MM, MARK_GAP_MM = 3.5, 1.5
"""Length of a mark outside a target, and its distance from it."""
AROUND_MM = MARK_MM + MARK_GAP_MM
TAG_MARK_MM = 4.0
"""Length of the marks to cut at."""
SMALLEST_M, LARGEST_M = 0.002, 10.0
"""Sides of a target."""
STEP_MM = 5.0
PRINT_TWO = "Two targets, one for each end of the bar"
PRINT_TWICE = "Print this sheet twice: one target for each end of the bar"
GAP_MM = 3.0
"""White paper between a board and the text below it."""
SMALLEST_SQUARE_MM = 1.0
KEPT = 8
"""Sheets that are laid out once: a page that offers one asks for it on every draw."""


def _sheet(
    title: str,
    paper: Paper,
    texts: Sequence[str],
    size_mm: tuple[float, float],
    counts: Sequence[tuple[int, int]],
    draw: Callable[[int, float, float], Group],
    around_mm: float = 0.0,
    gap_mm: float = 0.0,
) -> Sheet | None:
    """The paper, standing or lying, with drawings evenly spread; None if they do not fit.

    Args:
        size_mm: width and height of one drawing.
        counts: columns and rows that are tried.
        draw: its number and centre give a drawing.
        around_mm, gap_mm: free on all sides of a drawing, and above the texts.
    """
    for (columns, rows), turned in itertools.product(counts, paper.both_ways):
        width, height = _room(turned, texts, gap_mm)
        top = turned.height_mm - MARGIN_MM
        across = _spread(width, size_mm[0], columns, around_mm)
        down = _spread(height, size_mm[1], rows, around_mm)
        if across and down:
            places = enumerate(itertools.product(down, across))
            drawn = [draw(number, MARGIN_MM + x, top - y) for number, (y, x) in places]
            return Sheet(title, turned, Group(footer(texts, turned.width_mm), *drawn))
    return None


def _room(paper: Paper, texts: Sequence[str], gap_mm: float = 0.0) -> tuple[float, float]:
    """Width and height of what is free for drawings, in mm."""
    below = footer_height(texts, paper.width_mm) + gap_mm
    return paper.width_mm - 2.0 * MARGIN_MM, paper.height_mm - MARGIN_MM - below


def _spread(room: float, side: float, count: int, around: float) -> list[float]:
    """Where drawings have their centres along a length, evenly spread; empty if too short."""
    free = (room - count * side - (count + 1) * around) / (count + 1)
    step = side + around + free
    return [step * (place + 1) - 0.5 * side for place in range(count)] if free >= -1e-9 else []


def _fitting(make: Callable[[Paper], object]) -> str:
    """The first paper for which something can be made; empty if there is none."""
    return next((name for name, paper in PAPERS.items() if make(paper)), "")


@lru_cache(KEPT)
def print_targets(side_m: float, paper: Paper) -> Sheet:
    """A sheet with both targets if they fit, else with one, which is printed twice.

    Both are alike: detection calls one A and the other B by where they are. `side_m` is that of the
    whole target, of 2x2 squares.
    """
    if not SMALLEST_M <= side_m <= LARGEST_M:
        raise StereocalError(
            f"A target of {side_m:g} m cannot be printed: its side must be {SMALLEST_M:g} to "
            f"{LARGEST_M:g} m."
        )
    side, half = 1e3 * side_m, 500.0 * side_m

    def draw(_: int, x: float, y: float) -> Group:
        """Two black squares that meet in (x, y), with marks around to cut and to align by."""
        shapes = Group(block(x - half, y, half, half), block(x, y - half, half, half))
        start, end = half + MARK_GAP_MM, half + MARK_GAP_MM + MARK_MM
        for sign, across in itertools.product((-1.0, 1.0), (-half, 0.0, half)):
            shapes.add(stroke(x + across, y + sign * start, x + across, y + sign * end))
            shapes.add(stroke(x + sign * start, y + across, x + sign * end, y + across))
        return shapes

    def sheet(on: Paper) -> Sheet | None:
        for counts, often in (([(2, 1), (1, 2)], PRINT_TWO), ([(1, 1)], PRINT_TWICE)):
            texts, title = _target_texts(side, often), f"Target of {rounded(side, 4)} mm"
            if printed := _sheet(title, on, texts, (side, side), counts, draw, AROUND_MM):
                return printed
        return None

    if printed := sheet(paper):
        return printed
    room = min(_room(paper, _target_texts(100.0, PRINT_TWICE))) - 2.0 * AROUND_MM
    fits = _fitting(sheet)
    what = (
        f"print it on {fits}, in a copy shop if need be"
        if fits
        else "paint it on a board, with edges that meet in one point"
    )
    raise StereocalError(
        f"A target of {rounded(side, 4)} mm does not fit on {paper.name}, which holds "
        f"{STEP_MM * math.floor(room / STEP_MM):.0f} mm: {what}."
    )


def _target_texts(side: float, often: str) -> list[str]:
    return [
        f"stereocal target, {rounded(side, 4)} mm. {often}.",
        "Cut at the corner marks, and glue it to something flat and matt. The distance A-B of the "
        "bar is measured between the middles of the targets, where the four squares meet.",
        f"{ACTUAL_SIZE}, and the target {rounded(side, 4)} mm wide and high.",
    ]


def print_tags(tags: Tags, side_m: float, paper: Paper) -> Sheet:
    """A sheet with both tags; `side_m` is that of the black square, inside a border of a cell."""
    if not (np.isfinite(side_m) and side_m > 0):
        raise StereocalError(f"The side of a tag must be above 0, not {side_m:g} m.")
    side, (a, b) = 1e3 * side_m, tags.ids
    texts = [
        f"stereocal tags, {rounded(side, 4)} mm: A is {a}, B is {b} of {tags.dictionary}. Find "
        f"them with --target tags:{tags.dictionary}:{a},{b}.",
        "Cut at the marks, and leave the border white. Glue them to something flat and matt. The "
        "distance A-B of the bar is measured between the middles of the black squares.",
        f"{ACTUAL_SIZE}, and the black squares {rounded(side, 4)} mm wide and high.",
    ]
    cells = [marker_cells(f"DICT_{tags.dictionary}", number) for number in tags.ids]
    border = side + 2.0 * side / len(cells[0])

    def draw(number: int, x: float, y: float) -> Group:
        """A tag around (x, y), with marks at the corners of its white border."""
        shapes = Group(*_marker(cells[number], x, y, side))
        for across, up in itertools.product((-1, 1), repeat=2):
            u, v = x + 0.5 * across * border, y + 0.5 * up * border
            shapes.add(stroke(u, v, u + across * TAG_MARK_MM, v))
            shapes.add(stroke(u, v, u, v + up * TAG_MARK_MM))
        return shapes

    def sheet(on: Paper) -> Sheet | None:
        title, counts = f"Tags of {rounded(side, 4)} mm", ((2, 1), (1, 2))
        return _sheet(title, on, texts, (border, border), counts, draw, TAG_MARK_MM)

    if printed := sheet(paper):
        return printed
    fits = _fitting(sheet)
    raise StereocalError(
        f"Two tags of {rounded(side, 4)} mm do not fit on {paper.name}: take smaller ones"
        f"{f', or print them on {fits}' if fits else ''}."
    )


@lru_cache(KEPT)
def print_board(pattern: BoardPattern, paper: Paper) -> Sheet:
    """The board for the lens calibration on a sheet of paper."""
    side, columns, rows = 1e3 * pattern.square_m, pattern.columns + 1, pattern.rows + 1
    if side < SMALLEST_SQUARE_MM:
        raise StereocalError(
            f"Squares of {side:g} mm are too small to print sharply: use at least "
            f"{SMALLEST_SQUARE_MM:g} mm."
        )
    square, width, height = f"{rounded(side, 4)} mm", side * columns, side * rows

    def draw(_: int, x: float, y: float) -> Group:
        """The squares, black at the top left, and the markers in the white ones."""
        left, top = x - 0.5 * width, y + 0.5 * height
        # OpenCV's ChArUco board too is black at the top left.
        black = (np.arange(rows)[:, None] + np.arange(columns)) % 2 == 0
        shapes = Group()
        for row, column in np.argwhere(black):
            shapes.add(block(left + side * column, top - side * (row + 1), side, side))
        for number, (row, column) in enumerate(np.argwhere(~black) if pattern.dictionary else ()):
            middle = left + side * (column + 0.5), top - side * (row + 0.5)
            cells = marker_cells(str(pattern.dictionary), number)
            for cell in _marker(cells, *middle, 1e3 * (pattern.marker_m or 0.0)):
                shapes.add(cell)
        return shapes

    title, texts = f"Board {pattern}, squares of {square}", _board_texts(pattern)
    if printed := _sheet(title, paper, texts, (width, height), [(1, 1)], draw, gap_mm=GAP_MM):
        return printed
    fits = _fitting(lambda other: largest_square(pattern, other) >= pattern.square_m - 1e-9)
    largest = largest_square(pattern, paper)
    advice = [f"use squares of at most {1e3 * largest:.0f} mm"] if largest else []
    advice += [f"print it on {fits}, in a copy shop if need be"] if fits else []
    raise StereocalError(
        f"A board of {columns}x{rows} squares of {square} is {rounded(width, 4)} x "
        f"{rounded(height, 4)} mm and does not fit on {paper.name}: "
        f"{', or '.join(advice) or 'use fewer squares'}."
    )


def _board_texts(pattern: BoardPattern) -> list[str]:
    side = 1e3 * pattern.square_m
    kind = f"ChArUco board, {pattern.dictionary}" if pattern.dictionary else "Chessboard"
    marker = (
        f", side of a marker {rounded(1e3 * pattern.marker_m, 4)} mm" if pattern.marker_m else ""
    )
    return [
        f"{kind}. Enter: {pattern.columns} and {pattern.rows} inner corners, side of a square "
        f"{rounded(side, 4)} mm{marker}.",
        f"{ACTUAL_SIZE}, the board {side * (pattern.columns + 1):.1f} x "
        f"{side * (pattern.rows + 1):.1f} mm. Glue it to something flat and stiff; leave the paper "
        "around it white.",
    ]


def largest_square(pattern: BoardPattern, paper: Paper) -> float:
    """Side in metres of the largest squares, in whole mm, with which a board fits; 0: none."""
    squares = np.array([pattern.columns + 1, pattern.rows + 1])
    rooms = (_room(turned, _board_texts(pattern), GAP_MM) for turned in paper.both_ways)
    return 1e-3 * max(math.floor(max(float(np.min(room / squares)) for room in rooms)), 0)


def fitted(pattern: BoardPattern, paper: Paper) -> BoardPattern:
    """The board with the largest squares that fit on a paper, in whole mm."""
    square = largest_square(pattern, paper)
    if not square:
        raise StereocalError(
            f"{pattern.columns + 1}x{pattern.rows + 1} squares are too many for {paper.name}: use "
            "fewer, or larger paper."
        )
    marker = pattern.marker_m and square * pattern.marker_m / pattern.square_m
    return replace(pattern, square_m=square, marker_m=marker)


def marker_cells(dictionary: str, number: int) -> BoolArray:
    """(n, n): which cells of a marker are black, its border included."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    cells = markers.markerSize + 2
    return np.asarray(cv2.aruco.generateImageMarker(markers, number, cells)) < 128


def _marker(cells: BoolArray, x: float, y: float, side: float) -> list[Rect]:
    """The black cells of a marker around (x, y)."""
    cell, left, top = side / len(cells), x - 0.5 * side, y + 0.5 * side
    return [
        block(left + cell * column, top - cell * (row + 1), cell, cell)
        for row, column in np.argwhere(cells)
    ]
