"""Read YAML of Kalibr, ROS and OpenCV as plain data."""

from __future__ import annotations

import re
from typing import Any

import yaml

from stereocal.errors import DAMAGED, StereocalError

LONGEST = 50_000
"""Characters: our files have 4000; adversarial text of this length takes the parser 1 s."""
LONG_LIST = re.compile(r"\[[^\[\]]{4000,}\]")
"""Longer than any matrix of a camera: OpenCV's calibration program writes all found corners, and
200,000 characters would take 3 s."""
OPENCV_HEAD = re.compile(r"\A%YAML:1\.\d[^\n]*")
NUMBER = re.compile(
    r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.inf|\.nan", re.ASCII | re.IGNORECASE
)


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
    text = LONG_LIST.sub("[]", OPENCV_HEAD.sub("", text))
    check_length(text, source)
    try:
        data = yaml.load(text, Loader=_PlainLoader)
    except (yaml.YAMLError, *DAMAGED) as error:
        reason = str(error).splitlines()[0] if str(error) else "it is damaged"
        raise StereocalError(f"{source}: this is not valid YAML ({reason}).") from error
    if not isinstance(data, dict):
        raise StereocalError(f"{source}: this is not a parameter file (a YAML mapping).")
    return {str(key): value for key, value in data.items()}


def check_length(text: str, source: str) -> None:
    """Raise a `StereocalError` for a text that a parser written in Python would take long for."""
    if len(text) > LONGEST:
        raise StereocalError(f"{source}: {len(text)} characters are too many for a parameter file.")
