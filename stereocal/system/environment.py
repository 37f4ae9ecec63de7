"""Numbers from the environment, which set up a server; docs/deploy.md lists them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from stereocal.errors import StereocalError


def number_given(given: Mapping[str, str], name: str, default: float, least: float = 0.0) -> float:
    """The number of a variable, or `default` where it is not set or blank.

    Raises:
        StereocalError: no number, or one below `least`.
    """
    text = given.get(name, "").strip()
    if not text:
        return default
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not value >= least:
        raise StereocalError(f'{name} is "{text[:40]}": it must be a number, {least:g} or above.')
    return value
