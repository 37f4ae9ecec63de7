"""Read JSON from users within limits of its complexity, rejecting duplicate keys."""

import json
import re
from typing import Any

from stereocal.errors import StereocalError

DEEPEST = 50
"""Levels of objects and lists; our files have 6. What walks a value is recursive."""
MOST_VALUES = 1_000_000
"""A list of that many empty objects takes 75 MB and 0.2 s."""
TEXT_OR_BRACKET = re.compile(r'"(?:[^"\\]|\\.)*+(?:"|\\?\Z)|[\[\]{}]', re.DOTALL)


def read_json(content: bytes | str, source: str) -> Any:
    """The value of a JSON text (UTF-8).

    Of duplicate keys Python's reader silently takes the last, which hides mistakes in hand-edited
    files.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise StereocalError(f"{source}: this is not a text file (JSON in UTF-8).") from error
    check_depth(text, source)
    if sum(map(text.count, ",[{")) > MOST_VALUES:
        raise StereocalError(
            f"{source}: this has more than {MOST_VALUES:,} values; it is not read."
        )

    def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        entries: dict[str, Any] = {}
        for key, value in pairs:
            if key in entries:
                raise StereocalError(
                    f'{source}: the key "{key[:60]}" occurs twice in one object'
                    f"{_lines_of(key, text)}; keep the right one."
                )
            entries[key] = value
        return entries

    try:
        return json.loads(text, object_pairs_hook=object_of)
    except StereocalError:
        raise
    except (ValueError, RecursionError) as error:
        raise StereocalError(f"{source}: this is not valid JSON ({error}).") from error


def check_depth(text: str, source: str) -> None:
    """Check how deeply brackets outside texts are nested, before a parser recurses into them."""
    depth = 0
    for match in TEXT_OR_BRACKET.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(match[0], 0)
        if depth > DEEPEST:
            line = text.count("\n", 0, match.start()) + 1
            raise StereocalError(
                f"{source}: line {line} is nested more than {DEEPEST} levels deep; it is not read."
            )


def _lines_of(key: str, text: str) -> str:
    """The two lines with a key; empty if there are not exactly two."""
    hits = re.finditer(rf"{re.escape(json.dumps(key, ensure_ascii=False))}\s*:", text)
    lines = sorted({text.count("\n", 0, hit.start()) + 1 for hit in hits})
    return f" (lines {lines[0]} and {lines[1]})" if len(lines) == 2 else ""
