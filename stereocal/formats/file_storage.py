"""Read YAML of Kalibr, ROS and OpenCV, and the rest of OpenCV's FileStorage, as plain data."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from stereocal.errors import DAMAGED, StereocalError
from stereocal.formats.numpy_file import read_arrays
from stereocal.system.array_types import FloatArray
from stereocal.system.dialect import encoding_of
from stereocal.system.json_text import DEEPEST, read_json
from stereocal.system.zip_files import is_npz

LARGEST_BYTES = 4_000_000
Storage = Mapping[str, Any]
"""The nodes of a file: numbers, texts, lists, and matrices as `rows`, `cols` and `data`."""
LONGEST = 50_000
"""Characters: our files have 4000; adversarial text of this length takes the parser 1 s."""
LONG_LIST = re.compile(r"\[[^\[\]]{4000,}\]")
"""Longer than any matrix of a camera: OpenCV's calibration program writes all found corners, and
200,000 characters would take 3 s."""
LIST_OF_OBJECTS = re.compile(r"\[\s*\{")
OF_LENS = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
OF_FISHEYE = ("k1", "k2", "k3", "k4")
YAML_HEAD = re.compile(r"^%YAML\b.*", re.MULTILINE)
"""OpenCV's is not YAML's."""
BETWEEN_DOCUMENTS = re.compile(r"^(?:---|\.\.\.)(?=\s|$)", re.MULTILINE)
NOT_EMPTY = re.compile(r"^[ \t]*[^\s#]", re.MULTILINE)
MESSAGE_HEADER = re.compile(r"^header:.*\n(?:[ \t]+.*\n)*", re.MULTILINE)
"""Number and time of a ROS message."""
NUMBER = re.compile(
    r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.inf|\.nan", re.ASCII | re.IGNORECASE
)


@dataclass(frozen=True, eq=False)
class ForeignFile:
    """A file of another program."""

    name: str
    content: bytes

    def ends_with(self, *endings: str) -> bool:
        """Whether its name has one of these endings."""
        return self.name.lower().endswith(endings)

    @cached_property
    def text(self) -> str:
        """Its text."""
        if not self.content.strip():
            raise StereocalError("the file is empty.", self.name)
        if len(self.content) > LARGEST_BYTES:
            raise StereocalError(
                f"{len(self.content)} bytes are too many for a parameter file.", self.name
            )
        try:
            return self.content.decode(encoding_of(self.content))
        except UnicodeDecodeError as error:
            raise StereocalError("this is not a text file (UTF-8).", self.name) from error

    @cached_property
    def storage(self) -> Storage:
        """The nodes of a YAML, XML or JSON file, or of NumPy's arrays."""
        if is_npz(self.content):
            return with_matrices(read_arrays(self.content, self.name))
        return with_matrices(read_storage(self.text, self.name))


def read_storage(text: str, source: str) -> Storage:
    """The nodes of a file."""
    start = text.lstrip()
    if start.startswith("<"):
        return _read_xml(start, source)
    if not start.startswith("{") and not LIST_OF_OBJECTS.match(start):
        return read_yaml(text, source)
    data = read_json(start, source)
    return data if isinstance(data, dict) else {"cameras": data}


def with_matrices(storage: Storage) -> Storage:
    """The nodes, with a matrix K and coefficients where they are given number by number: fx, fy,
    cx, cy, and k1 k2 p1 p2 k3 [k4 k5 k6] of OpenCV's lens or k1 k2 k3 k4 of its fisheye."""
    focal = [storage.get(name) for name in ("fx", "fy", "cx", "cy")]
    if "K" in storage or not all(map(is_numeric, focal)):
        return storage
    fx, fy, cx, cy = focal
    lens = {name: storage[name] for name in OF_LENS if is_numeric(storage.get(name))}
    rest = {name: node for name, node in storage.items() if name not in lens}
    node = {**rest, "K": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]}
    if not lens:
        return node
    if "k4" in lens and not {"k5", "k6", "p1", "p2"} & lens.keys():
        return {"distortion_model": "fisheye", **node, "D": [lens.get(k, 0.0) for k in OF_FISHEYE]}
    names = OF_LENS if {"k4", "k5", "k6"} & lens.keys() else OF_LENS[:5]
    return {**node, "D": [lens.get(name, 0.0) for name in names]}


def find_node(storage: Storage, names: Sequence[str]) -> Any:
    """The first node found with one of these names, else None.

    Capitals, `_`, `-`, `.` and spaces do not count in names of more than two characters: k1 is a
    coefficient, K1 a matrix.
    """
    plain = {plain_name(key): node for key, node in storage.items()}
    nodes = (plain.get(plain_name(name)) for name in names)
    return next((node for node in nodes if node is not None), None)


def plain_name(name: str) -> str:
    """A name of more than two characters without what does not count in it."""
    return name if len(name) < 3 else re.sub(r"[\s_.-]", "", name).lower()


def matrix_of(node: Any, name: str, source: str) -> FloatArray:
    """(rows, cols): an OpenCV matrix, or a list of rows or of numbers (one row)."""
    rows, cols = (node.get("rows"), node.get("cols")) if isinstance(node, dict) else (0, 0)
    data = node.get("data") if isinstance(node, dict) else node
    if not isinstance(data, list) or type(rows) is not int or type(cols) is not int:
        raise StereocalError(f"{source}: {name} is not a matrix (!!opencv-matrix).")
    table = data if data and all(isinstance(row, list) for row in data) else [data]
    if len({len(row) for row in table}) != 1:
        raise StereocalError(f"{source}: the rows of {name} differ in length.")
    if not all(is_numeric(value) for row in table for value in row):
        raise StereocalError(f"{source}: {name} contains something that is not a number.")
    matrix = np.array(table, dtype=np.float64)
    if not isinstance(node, dict):
        return matrix
    if min(rows, cols) >= 0 and rows * cols == matrix.size:
        return matrix.reshape(rows, cols)
    if "dt" in node:  # an OpenCV matrix, which may be cut; ROS files have the wrong size at times
        raise StereocalError(f"{source}: {name} does not have rows x cols numbers.")
    return matrix


def is_numeric(value: object) -> bool:
    """Whether a node is a number within the range of int64 or float64."""
    return isinstance(value, float) or (type(value) is int and abs(value) < 1 << 63)


def parse_xml(text: str, source: str) -> ElementTree.Element:
    """The root of an XML text."""
    # Entity expansion attacks need a document type, which OpenCV does not write.
    if "<!DOCTYPE" in text:
        raise StereocalError(f"{source}: XML with a document type is not read; remove it.")
    try:
        return ElementTree.fromstring(text.lstrip())
    except (ElementTree.ParseError, ValueError) as error:
        raise StereocalError(f"{source}: this is not valid XML ({error}).") from error


def _read_xml(text: str, source: str) -> Storage:
    nodes = _children(parse_xml(text, source), source)
    return nodes if isinstance(nodes, dict) else {}


def _children(element: ElementTree.Element, source: str, depth: int = 0) -> Any:
    """The value of an element; OpenCV's lists are numbers in its text, or elements named `_`."""
    if depth > DEEPEST:
        raise StereocalError(f"{source}: this is not a camera file, it is nested too deeply.")
    if not len(element):
        values = [_value(word) for word in (element.text or "").split()]
        if all(map(is_numeric, values)) and values:
            return values[0] if len(values) == 1 and element.tag != "data" else values
        return (element.text or "").strip().strip('"')
    children = [(child.tag, _children(child, source, depth + 1)) for child in element]
    if all(tag == "_" for tag, _ in children):
        return [value for _, value in children]
    nodes = dict(children)
    if len(nodes) < len(children):
        raise StereocalError(f"{source}: <{element.tag[:60]}> contains a name twice.")
    return nodes


def _value(word: str) -> Any:
    for kind in (int, float):
        try:
            return kind(word.lower().replace(".nan", "nan").replace(".inf", "inf"))
        except ValueError:
            continue
    return word


class _PlainLoader(yaml.SafeLoader):  # type: ignore[misc]  # the package has no types
    """Loads plain data. Aliases are rejected, since they can expand to gigabytes."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases are not read")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Reject duplicate keys, of which the base class takes the last."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(set(keys)) < len(keys):
            twice = next(key for k, key in enumerate(keys) if key in keys[:k])
            line = node.start_mark.line + 1
            raise yaml.YAMLError(
                f'the key "{twice[:60]}" occurs twice in the mapping that begins in line {line}'
            )
        return super().construct_mapping(node, deep)

    def construct_tagged(self, _: str, node: Any) -> Any:
        """The plain value behind an unknown tag such as !!opencv-matrix."""
        if isinstance(node, yaml.MappingNode):
            return self.construct_mapping(node, deep=True)
        if isinstance(node, yaml.SequenceNode):
            return self.construct_sequence(node, deep=True)
        return self.construct_scalar(node)


_PlainLoader.add_multi_constructor("", _PlainLoader.construct_tagged)
# YAML 1.1 requires a point and a sign: 1e-05 would be read as text.
_PlainLoader.add_implicit_resolver("tag:yaml.org,2002:float", NUMBER, list("-+.0123456789"))


def read_yaml(text: str, source: str) -> dict[str, Any]:
    """The mapping in a YAML text."""
    text = _document(LONG_LIST.sub("[]", YAML_HEAD.sub("", text.replace("\r\n", "\n"))), source)
    check_text_length(text, source)
    try:
        data = yaml.load(text, Loader=_PlainLoader)
    except (yaml.YAMLError, *DAMAGED) as error:
        reason = str(error).splitlines()[0] if str(error) else "it is damaged"
        raise StereocalError(f"{source}: this is not valid YAML ({reason}).") from error
    if not isinstance(data, dict):
        raise StereocalError(f"{source}: this is not a parameter file (a YAML mapping).")
    return {str(key): value for key, value in data.items()}


def _document(text: str, source: str) -> str:
    """The only document in a YAML text; a stream of ROS messages of one camera counts as one."""
    documents = [*filter(NOT_EMPTY.search, BETWEEN_DOCUMENTS.split(text))]
    if len(documents) < 2:
        return BETWEEN_DOCUMENTS.sub("", text)  # errors count its lines
    first, *more = (MESSAGE_HEADER.sub("", document).strip() for document in documents)
    if not all(map(first.startswith, more)):  # the last message may be cut
        raise StereocalError(
            f"{source}: it contains different YAML documents (between lines ---); give each camera "
            "a file of its own."
        )
    return documents[0]


def check_text_length(text: str, source: str) -> None:
    """Raise a `StereocalError` for a text that a parser written in Python would take long for."""
    if len(text) > LONGEST:
        raise StereocalError(f"{source}: {len(text)} characters are too many for a parameter file.")
