"""The board for the lens calibration to print: a chessboard, or a ChArUco board."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
from reportlab.graphics.shapes import Group

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
)
from stereocal.rig.board_pattern import BoardPattern
from stereocal.rig.compiled import BoolArray
from stereocal.system.numbers import rounded

GAP_MM = 3.0
"""White paper between the board and the text below it."""
SMALLEST_SQUARE_MM = 1.0


def print_board(pattern: BoardPattern, paper: Paper) -> Sheet:
    """The board on a sheet of paper, at true scale."""
    if 1e3 * pattern.square_m < SMALLEST_SQUARE_MM:
        raise StereocalError(
            f"Squares of {1e3 * pattern.square_m:g} mm are too small to print sharply: use at "
            f"least {SMALLEST_SQUARE_MM:g} mm."
        )
    for turned in paper.both_ways:
        width, height = _size_mm(pattern)
        across, up = _room(pattern, turned)
        if width <= across + 1e-9 and height <= up + 1e-9:
            texts = _texts(pattern)
            below = turned.height_mm - MARGIN_MM - up
            left, bottom = 0.5 * (turned.width_mm - width), below + 0.5 * (up - height)
            shapes = Group(footer(texts, turned.width_mm), _board(pattern, left, bottom))
            return Sheet(f"Board {pattern}, squares of {_square(pattern)}", turned, shapes)
    raise StereocalError(_too_large(pattern, paper))


def largest_square(pattern: BoardPattern, paper: Paper) -> float:
    """Side in metres of the largest squares, in whole mm, with which the board fits on a paper.

    0 if there are none.
    """
    squares = np.array([pattern.columns + 1, pattern.rows + 1])
    sides = (float(np.min(_room(pattern, turned) / squares)) for turned in paper.both_ways)
    return 1e-3 * max(math.floor(max(sides)), 0)


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


def _texts(pattern: BoardPattern) -> list[str]:
    width, height = _size_mm(pattern)
    kind = f"ChArUco board, {pattern.dictionary}" if pattern.dictionary else "Chessboard"
    marker = (
        f", side of a marker {rounded(1e3 * pattern.marker_m, 4)} mm" if pattern.marker_m else ""
    )
    return [
        f"{kind}. Enter: {pattern.columns} and {pattern.rows} inner corners, side of a square "
        f"{_square(pattern)}{marker}.",
        f"{ACTUAL_SIZE}, the board {width:.1f} x {height:.1f} mm. Glue it to something flat and "
        "stiff; leave the paper around it white.",
    ]


def _square(pattern: BoardPattern) -> str:
    return f"{rounded(1e3 * pattern.square_m, 4)} mm"


def _size_mm(pattern: BoardPattern) -> tuple[float, float]:
    side = 1e3 * pattern.square_m
    return side * (pattern.columns + 1), side * (pattern.rows + 1)


def _room(pattern: BoardPattern, paper: Paper) -> tuple[float, float]:
    """Width and height for the squares, in mm."""
    below = footer_height(_texts(pattern), paper.width_mm) + GAP_MM
    return paper.width_mm - 2.0 * MARGIN_MM, paper.height_mm - MARGIN_MM - below


def _too_large(pattern: BoardPattern, paper: Paper) -> str:
    width, height = _size_mm(pattern)
    fits = [
        name
        for name, other in PAPERS.items()
        if largest_square(pattern, other) >= (pattern.square_m - 1e-9)
    ]
    advice = (
        [f"use squares of at most {1e3 * square:.0f} mm"]
        if (square := largest_square(pattern, paper))
        else []
    )
    advice += [f"print it on {fits[0]}, in a copy shop if need be"] if fits else []
    return (
        f"A board of {pattern.columns + 1}x{pattern.rows + 1} squares of {_square(pattern)} is "
        f"{rounded(width, 4)} x {rounded(height, 4)} mm and does not fit on {paper.name}: "
        f"{', or '.join(advice) or 'use fewer squares'}."
    )


def _board(pattern: BoardPattern, left: float, bottom: float) -> Group:
    """The squares, black at the top left, and the markers in the white ones."""
    side, rows = 1e3 * pattern.square_m, pattern.rows + 1
    shapes = Group()
    for row, column in np.argwhere(_black_squares(pattern)):
        shapes.add(block(left + side * column, bottom + side * (rows - 1 - row), side, side))
    if pattern.dictionary is None:
        return shapes
    for number, (row, column) in enumerate(np.argwhere(~_black_squares(pattern))):
        marker = marker_cells(pattern.dictionary, number)
        cell = 1e3 * (pattern.marker_m or 0.0) / len(marker)
        edge = 0.5 * (side - cell * len(marker))
        top = bottom + side * (rows - row) - edge
        for line, place in np.argwhere(marker):
            x = left + side * column + edge + cell * place
            shapes.add(block(x, top - cell * (line + 1), cell, cell))
    return shapes


def _black_squares(pattern: BoardPattern) -> BoolArray:
    """(rows, columns) of the squares; OpenCV's ChArUco board too is black at the top left."""
    squares = np.arange(pattern.rows + 1)[:, None] + np.arange(pattern.columns + 1)
    return np.asarray(squares % 2 == 0)


def marker_cells(dictionary: str, number: int) -> BoolArray:
    """(n, n): which cells of a marker are black, its border included."""
    markers = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    cells = markers.markerSize + 2
    return np.asarray(cv2.aruco.generateImageMarker(markers, number, cells)) < 128
