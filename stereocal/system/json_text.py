"""JSON that a person gives: read by one function, which refuses what has two meanings."""

from __future__ import annotations

import json
import re
from typing import Any

from stereocal.errors import StereocalError


def read_json(content: bytes | str, source: str) -> Any:
    """The value of a JSON text (UTF-8).

    Python's own reader takes the last of two equal keys, without a word: half of a file that was
    edited by hand is then not what its owner reads in it.

    Raises:
        StereocalError: no text, no JSON, or an object in which a key stands twice.
    """
    try:
        text = content if isinstance(content, str) else content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise StereocalError(f"{source}: this is not a text file (JSON in UTF-8).") from error

    def object_of(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found: dict[str, Any] = {}
        for key, value in pairs:
            if key in found:
                raise StereocalError(
                    f'{source}: the key "{key[:60]}" stands twice in one object'
                    f"{_lines_of(key, text)}; keep the one that is meant."
                )
            found[key] = value
        return found

    try:
        return json.loads(text, object_pairs_hook=object_of)
    except StereocalError:
        raise
    except (ValueError, RecursionError) as error:
        raise StereocalError(f"{source}: this is not valid JSON ({error}).") from error


def _lines_of(key: str, text: str) -> str:
    """The lines in which a key stands, where it stands in two."""
    places = re.finditer(rf"{re.escape(json.dumps(key, ensure_ascii=False))}\s*:", text)
    lines = sorted({text.count("\n", 0, place.start()) + 1 for place in places})
    return f" (lines {lines[0]} and {lines[1]})" if len(lines) == 2 else ""
