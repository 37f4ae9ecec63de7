"""YAML of strangers, read without surprises."""

from __future__ import annotations

from typing import Any

import yaml

from stereocal.errors import StereocalError
from stereocal.formats.exchange.options import text_of

LONGEST = 100_000
"""Ours have 4000 characters. The parser takes 15 s for a million, and longer for odd ones."""


class _PlainLoader(yaml.SafeLoader):  # type: ignore[misc]  # the package has no types
    """Plain data only. No aliases: a few hundred bytes of them can stand for gigabytes."""

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent):
            raise yaml.YAMLError("aliases are not read")
        return super().compose_node(parent, index)

    def construct_mapping(self, node: Any, deep: bool = False) -> Any:
        """Its base takes the last of two equal keys."""
        keys = [key.value for key, _ in node.value if isinstance(key, yaml.ScalarNode)]
        if len(set(keys)) < len(keys):
            twice = next(key for k, key in enumerate(keys) if key in keys[:k])
            line = node.start_mark.line + 1
            raise yaml.YAMLError(
                f'the key "{twice[:60]}" stands twice in what begins in line {line}'
            )
        return super().construct_mapping(node, deep)


def read_mapping(content: bytes, source: str) -> dict[str, Any]:
    """The mapping that a YAML file holds.

    Raises:
        StereocalError: no YAML, or no mapping.
    """
    text = text_of(content, source)
    if len(text) > LONGEST:
        raise StereocalError(f"{source}: {len(text)} characters are too many for a parameter file.")
    try:
        data = yaml.load(text, Loader=_PlainLoader)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = str(error).splitlines()[0] if str(error) else "it is damaged"
        raise StereocalError(f"{source}: this is not valid YAML ({reason}).") from error
    if not isinstance(data, dict):
        raise StereocalError(f"{source}: this is not a parameter file (a YAML mapping).")
    return {str(key): value for key, value in data.items()}
