"""Numeric settings from environment variables; docs/deploy.md lists them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from stereocal.errors import StereocalError


def number_given(
    environment: Mapping[str, str], name: str, default: float, least: float = 0.0
) -> float:
    """The number in a variable; `default` if it is not set or blank."""
    text = environment.get(name, "").strip()
    if not text:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value >= least:
        raise StereocalError(f'{name} is "{text[:40]}": it must be a number, {least:g} or above.')
    return value
