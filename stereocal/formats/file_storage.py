"""Read OpenCV FileStorage (YAML, XML, JSON) as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree

import numpy as np

from stereocal.errors import StereocalError
from stereocal.formats.yaml_text import read_yaml
from stereocal.rig.compiled import FloatArray
from stereocal.system.json_text import DEEPEST, read_json

Storage = Mapping[str, Any]
"""The nodes of a file: numbers, texts, lists, and matrices as `rows`, `cols` and `data`."""


def read_storage(text: str, source: str) -> Storage:
    """The nodes of a file."""
    start = text.lstrip()
    if start.startswith("<"):
        return _read_xml(start, source)
    if not start.startswith("{"):
        return read_yaml(start, source)
    data = read_json(start, source)
    return data if isinstance(data, dict) else {}


def find_node(storage: Storage, names: tuple[str, ...]) -> Any:
    """The first node found with one of these names, else None."""
    return next((storage[name] for name in names if name in storage), None)


def matrix_of(node: Any, name: str, source: str) -> FloatArray:
    """(rows, cols): an OpenCV matrix, or a list of rows or of numbers (one row)."""
    rows, cols = (node.get("rows"), node.get("cols")) if isinstance(node, dict) else (0, 0)
    data = node.get("data") if isinstance(node, dict) else node
    if not isinstance(data, list) or type(rows) is not int or type(cols) is not int:
        raise StereocalError(f"{source}: {name} is not a matrix (!!opencv-matrix).")
    table = data if data and all(isinstance(row, list) for row in data) else [data]
    if len({len(row) for row in table}) != 1:
        raise StereocalError(f"{source}: the rows of {name} differ in length.")
    if not all(is_number(value) for row in table for value in row):
        raise StereocalError(f"{source}: {name} contains something that is not a number.")
    found = np.array(table, dtype=np.float64)
    if not isinstance(node, dict):
        return found
    if min(rows, cols) < 0 or rows * cols != found.size:
        raise StereocalError(f"{source}: {name} does not have rows x cols numbers.")
    return found.reshape(rows, cols)


def is_number(value: object) -> bool:
    """Whether a node is a number within the range of int64 or float64."""
    return isinstance(value, float) or (type(value) is int and abs(value) < 1 << 63)


def stated_lens_model(storage: Storage) -> str | bool | None:
    """The name of the lens model in a file, or whether it is a fisheye; None if not stated."""
    model, fisheye = storage.get("distortion_model"), storage.get("fisheye_model")
    if isinstance(model, str):
        return model
    return bool(fisheye) if isinstance(fisheye, int) else None  # of OpenCV's calibration program


def _read_xml(text: str, source: str) -> Storage:
    # Entity expansion attacks need a document type, which OpenCV does not write.
    if "<!DOCTYPE" in text:
        raise StereocalError(f"{source}: XML with a document type is not read; remove it.")
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, ValueError) as error:
        raise StereocalError(f"{source}: this is not valid XML ({error}).") from error
    nodes = _children(root, source)
    return nodes if isinstance(nodes, dict) else {}


def _children(element: ElementTree.Element, source: str, depth: int = 0) -> Any:
    """The value of an element; OpenCV's lists are numbers in its text, or elements named `_`."""
    if depth > DEEPEST:
        raise StereocalError(f"{source}: this is not a camera file, it is nested too deeply.")
    if not len(element):
        values = [_value(word) for word in (element.text or "").split()]
        if all(map(is_number, values)) and values:
            return values[0] if len(values) == 1 and element.tag != "data" else values
        return (element.text or "").strip().strip('"')
    children = [(child.tag, _children(child, source, depth + 1)) for child in element]
    if all(tag == "_" for tag, _ in children):
        return [value for _, value in children]
    found = dict(children)
    if len(found) < len(children):
        raise StereocalError(f"{source}: <{element.tag[:60]}> contains a name twice.")
    return found


def _value(word: str) -> Any:
    for kind in (int, float):
        try:
            return kind(word.lower().replace(".nan", "nan").replace(".inf", "inf"))
        except ValueError:
            continue
    return word
