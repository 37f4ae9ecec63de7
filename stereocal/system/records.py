"""Dataclasses as JSON and back, by msgspec: types are checked, arrays become nested lists.

Numbers are read back exactly, NaN and infinity too, as Python writes them.
"""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar, cast, get_args

import msgspec
import numpy as np

from stereocal.errors import StereocalError

T = TypeVar("T")


def plain(value: Any) -> Any:
    """A dataclass or a collection of them as dictionaries, lists, strings and numbers."""
    return json.loads(pack(value))


def of_plain(data: Any, kind: type[T]) -> T:
    """The inverse of `plain`. Missing fields keep their defaults, unknown names are ignored.

    Raises:
        ValueError: a value has another type, or is missing; or as the dataclass itself.
    """
    try:
        return msgspec.convert(data, kind, dec_hook=_list_as_array)
    except msgspec.ValidationError as error:
        if isinstance(error.__cause__, ValueError):  # of the dataclass itself
            raise error.__cause__ from None
        raise ValueError(str(error)) from error


def pack(value: Any) -> bytes:
    """The plain values of a dataclass, as JSON."""
    return json.dumps(value, default=_parts_of).encode()


def unpack(content: bytes, kind: type[T]) -> T:
    """The inverse of `pack`.

    Raises:
        ValueError: as `of_plain`, or the content is not JSON.
    """
    return of_plain(json.loads(content), kind)


def settings_of(data: Mapping[str, Any], kind: type[T], what: str = "settings") -> T:
    """Build settings that a person may have written from plain values; `what` they are."""
    names = {part.name for part in fields(cast(Any, kind))}
    try:
        if isinstance(data, Mapping) and (unknown := sorted(set(data) - names)):
            raise ValueError(f"unknown: {', '.join(unknown)}")
        return of_plain(data, kind)
    except StereocalError:
        raise
    except ValueError as error:
        raise StereocalError(f"The {what} cannot be read: {error}.") from error


def _parts_of(value: Any) -> Any:
    # By name: msgspec leaves a default to the class, where its own writer does not find it.
    if is_dataclass(value):
        return {part.name: getattr(value, part.name) for part in fields(value)}
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Mapping):
        return dict(value)
    raise TypeError(type(value))


def _list_as_array(kind: Any, value: Any) -> Any:
    (dtype,) = get_args(get_args(kind)[1])
    return np.array(value, dtype=dtype)
