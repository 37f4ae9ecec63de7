"""Settings that are described once, at their field: bounds, option and widget come from there."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import Any

from stereocal.errors import StereocalError

_ABOUT = "about"


@dataclass(frozen=True)
class About:
    """What is said of a setting."""

    title: str
    help: str
    low: float
    high: float
    choices: tuple[str, ...]
    option: str
    """On the command line, without the dashes; empty: as the field."""
    default: Any


def described(
    default: Any,
    title: str,
    text: str,
    *,
    between: tuple[float, float] = (0, 0),
    choices: Sequence[str] = (),
    option: str = "",
) -> Any:
    """The field of a setting: a number within bounds, a choice, a switch, or numbers of frames."""
    about = About(title, text, *between, tuple(choices), option, default)
    return field(default=default, metadata={_ABOUT: about})


def descriptions(settings: type) -> dict[str, About]:
    """The described fields of a dataclass by name."""
    return {each.name: each.metadata[_ABOUT] for each in fields(settings) if each.metadata}


def check_described(settings: Any) -> None:
    """Raise a `StereocalError` for a setting that is out of its bounds or none of its choices."""
    for name, about in descriptions(type(settings)).items():
        value = getattr(settings, name)
        if about.choices and value not in about.choices:
            raise StereocalError(f"{name} is {value!r}: it must be {' or '.join(about.choices)}.")
        if about.low < about.high and not about.low <= value <= about.high:
            raise StereocalError(
                f"{name} is {value}: it must be from {about.low:g} to {about.high:g}."
            )
