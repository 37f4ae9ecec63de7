"""OpenCV FileStorage (YAML, XML, JSON): opened without risk, read number by number."""

from __future__ import annotations

import re
from typing import Any

import cv2
import numpy as np

from stereocal.errors import StereocalError
from stereocal.rig.compiled import FloatArray

MOST_VALUES = 100
DEEPEST = 50
"""OpenCV's parser calls itself for every level, and ends the whole program when there are many."""
BLANKS_A_LEVEL = 20
"""Far more than anybody indents a level by."""


def open_storage(text: str, source: str) -> Any:
    """A `cv2.FileStorage` of a text; the caller releases it.

    Raises:
        StereocalError: damaged, or nested too deeply.
    """
    if _depth(text) > DEEPEST:
        raise StereocalError(f"{source}: this is not a camera file, it is nested too deeply.")
    try:
        return cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    except (cv2.error, SystemError) as error:
        raise StereocalError(
            f"{source}: OpenCV cannot read this file; it is cut off or damaged."
        ) from error


def find_node(storage: Any, names: tuple[str, ...]) -> Any:
    """The first node of these names that is there, else None."""
    for name in names:
        node = storage.getNode(name)
        if not node.empty():
            return node
    return None


def matrix_of(node: Any, name: str, source: str) -> FloatArray:
    """The numbers of an OpenCV matrix, or of a plain sequence: (rows, cols), or one row.

    Read one by one: `FileNode.mat()` of OpenCV 5.0 writes past its memory, and ends the whole
    program, where rows or cols are missing or negative.

    Raises:
        StereocalError: no matrix, or not of numbers.
    """
    if node.isSeq():
        parts = [node.at(i) for i in range(min(node.size(), MOST_VALUES))]
        if any(part.isSeq() for part in parts):
            table = [_row(part, name, source) for part in parts]
            if len({len(row) for row in table}) != 1:
                raise StereocalError(f"{source}: the rows of {name} are not equally long.")
            return np.array(table, dtype=np.float64)
        return np.array([_row(node, name, source)], dtype=np.float64)
    rows, cols, data = (
        node.getNode(key) if node.isMap() else None for key in ("rows", "cols", "data")
    )
    if rows is None or cols is None or data is None or not (rows.isInt() and cols.isInt()):
        raise StereocalError(f"{source}: {name} is not a matrix (!!opencv-matrix).")
    shape = (int(rows.real()), int(cols.real()))
    numbers = _row(data, name, source)
    if min(shape) < 0 or shape[0] * shape[1] != len(numbers):
        raise StereocalError(f"{source}: {name} does not hold the numbers of a matrix.")
    return np.array(numbers, dtype=np.float64).reshape(shape)


def lens_model_of(storage: Any) -> str | bool | None:
    """What a file says of its lens model: its name, or whether it is a fisheye."""
    node = storage.getNode("distortion_model")
    if node.isString():
        return str(node.string())
    node = storage.getNode("fisheye_model")  # of OpenCV's calibration program
    return bool(node.real()) if node.isInt() else None


def _row(node: Any, name: str, source: str) -> list[float]:
    values = [node.at(i) for i in range(min(node.size(), MOST_VALUES))] if node.isSeq() else []
    if not all(value.isInt() or value.isReal() for value in values):
        raise StereocalError(f"{source}: {name} holds something that is not a number.")
    return [value.real() for value in values]


def _depth(text: str) -> int:
    """At least as many levels as the brackets, tags, dashes, names and blanks of a file nest."""
    depth = deepest = 0
    for mark in re.finditer(r"[\[{]|[\]}]|</|/>|<(?=\w)", text):
        depth += -1 if mark[0] in ("]", "}", "</", "/>") else 1
        deepest = max(deepest, depth)
    if text.lstrip().startswith("{"):  # JSON, in which names of one level may share a line
        return deepest
    return max(deepest, max(map(_depth_of_line, text.splitlines()), default=0))


def _depth_of_line(line: str) -> int:
    """At least as many levels as a line of YAML opens, in `- - a: b: 1`, or stands in."""
    code = line.lstrip(" \t")
    if code.startswith("#"):
        return 0
    dashes = len(re.findall(r"-(?=[ \t-])", code))  # not that of a number
    return max((len(line) - len(code)) // BLANKS_A_LEVEL, dashes, code.count(":"))
