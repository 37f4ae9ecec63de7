"""Numeric settings from environment variables; docs/deploy.md lists them."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any, TypeVar

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
    usual: Any = kind()
    return kind(
        **{
            field: number_given(given, variable, getattr(usual, field), least)
            for field, variable in variables.items()
        }
    )


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
