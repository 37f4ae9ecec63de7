"""What a result was made from, part by part, and what of it is another now."""

import hashlib
import json
from collections.abc import Mapping
from typing import Any

Parts = Mapping[str, Any]
"""What a result was made from, as JSON, each part by its name in words. A number or a word is shown
where it has changed; of a list only the name is."""


def digest_of(value: Any) -> str:
    """SHA-256 of a value as JSON."""
    return hashlib.sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()


def as_digests(parts: Parts) -> Parts:
    """The parts, each in the length of a digest."""
    return {name: [digest_of(value)] for name, value in parts.items()}


def changed(then: Parts, now: Parts) -> str:
    """What is another now than when a result was made, as a list in words; empty: it is current.

    A part that was not stored with the result, which an earlier version made, is not compared.
    """
    before, after = (json.loads(json.dumps({**parts})) for parts in (then, now))
    return ", ".join(
        name if isinstance(value, (list, dict)) else f"{name} ({_shown(was)}, now {_shown(value)})"
        for name, value in after.items()
        if (was := before.get(name, value)) != value
    )


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    if value is None:
        return "all"
    return f"{value:.12g}" if isinstance(value, float) else f"{value}"
