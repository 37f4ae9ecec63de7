"""Numeric settings from environment variables; docs/deploy.md lists them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import TypeVar

from stereocal.errors import StereocalError

T = TypeVar("T")


def from_environment(
    kind: type[T],
    variables: Mapping[str, str],
    environment: Mapping[str, str] | None,
    least: float = 0.0,
) -> T:
    """A dataclass of numbers, each from its variable; where that is not set, its default.

    Args:
        variables: their names by those of the fields.
        environment: None: that of the process.
    """
    given = os.environ if environment is None else environment
    found = {}
    for field, variable in variables.items():
        if not (text := given.get(variable, "").strip()):
            continue
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if not value >= least:
            raise StereocalError(
                f'{variable} is "{text[:40]}": it must be a number, {least:g} or above.'
            )
        found[field] = value
    return kind(**found)
